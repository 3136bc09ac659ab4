"""An address where a path is taken: refused as it was typed, by every verb that takes a path."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from typer.testing import CliRunner

from terraport.cli import app
from terraport.cli.addresses import _path_names, refuse_address
from terraport.cli.lazy import VERBS, _load

ADDRESS = "s3://bucket/deep/thing.laz"


def commands(command: Any, words: list[str]) -> Iterator[tuple[list[str], Any]]:
    """The commands of a verb, which may be a group of them."""
    inner = getattr(command, "commands", None)
    if not inner:
        yield words, command
    else:
        for name, each in inner.items():
            yield from commands(each, [*words, name])


def places() -> Iterator[list[str]]:
    """Command lines with an address at every place of every command where a path is taken."""
    for verb in VERBS:
        for words, command in commands(_load(verb), [verb.name]):
            arguments = [each for each in command.params if each.param_type_name == "argument"]
            for parameter in command.params:
                if parameter.name not in _path_names(command):
                    continue
                if parameter in arguments:
                    before = ["x"] * arguments.index(parameter)
                    yield [*words, *before, ADDRESS]
                else:
                    for flag in parameter.opts:
                        yield [*words, flag, ADDRESS]
                    yield [*words, "x", f"{parameter.opts[0]}={ADDRESS}"]


PLACES = list(places())


def test_every_verb_was_looked_at() -> None:
    flags = {(line[0], line[-2]) for line in PLACES}
    for known in (
        ("build", "build"),
        ("build", "-o"),
        ("build", "--photos"),
        ("build", "--cameras"),
        ("build", "--work"),
        ("land", "--png"),
        ("label", "x"),
        ("export", "-o"),
        ("report", "report"),
        ("serve", "--tokens-file"),
        ("synth", "-o"),
        ("upload", "upload"),
    ):
        assert known in flags


@pytest.mark.parametrize("line", PLACES, ids=" ".join)
def test_it_is_one_line_with_what_was_typed_and_what_to_do(line: list[str]) -> None:
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"error: {ADDRESS} is an address, and ")
    assert len(done.stderr.splitlines()) == 1
    assert ";" in done.stderr
    assert "s3:/bucket" not in done.stderr


@pytest.mark.parametrize(
    ("verb", "name", "text", "advice"),
    [
        ("build", "survey", "s3://b/a.laz", "fetch it first: aws s3 cp s3://b/a.laz ."),
        ("build", "survey", "gs://b/tiles/", "gcloud storage cp gs://b/tiles/ tiles --recursive"),
        ("build", "photos", "az://b/photos", "azcopy copy az://b/photos photos --recursive"),
        ("build", "survey", "https://x.org/a.laz", "fetch it first: curl -O https://x.org/a.laz"),
        ("build", "output", "s3://b/pit", "terraport upload SCENE s3://b/pit"),
        ("build", "work", "s3://b/w", "expected a folder on a disk of this machine"),
        ("land", "png", "s3://b/a.png", "write it here, then: aws s3 cp FILE s3://b/a.png"),
        ("land", "png", "ftp://b/a.png", "write it here and bring it there"),
        ("upload", "scene", "s3://b/pit", "terraport mv s3://b/pit"),
        ("build", "survey", "s3:/b/a.laz", "aws s3 cp s3://b/a.laz ."),
    ],
)
def test_what_to_do(verb: str, name: str, text: str, advice: str) -> None:
    fault = refuse_address(verb, "--x", name, text)
    assert fault is not None
    assert advice in fault


def test_paths_are_paths(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    for text in ("a.laz", "/a/b", "C:/x", "c:\\x", "s3", "tiles/*.laz", "./s3:/x", ""):
        assert refuse_address("build", "SURVEY", "survey", text) is None
    # A folder may be called anything.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s3:").mkdir()
    (tmp_path / "s3:" / "x").touch()
    assert refuse_address("build", "SURVEY", "survey", "s3:/x") is None
