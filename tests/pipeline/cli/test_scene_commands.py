"""``terraport list``, ``mv``, ``rm`` and ``diff``: what is said, and the exit status."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from s3_servers import FaultProxy, s3_environment
from store.tiny_scene import TinyScene, write_tiny_scene
from typer.testing import CliRunner, Result

from terraport_pipeline.cli import diff, inspect, label, list_scenes, mv, rm, upload
from terraport_pipeline.workflow.scene_lock import scene_locked
from terraport_pipeline.workflow.workdir import WorkDirectory
from terraport_store import validate_scene


def run(*arguments: object, typed: str | None = None) -> Result:
    app = typer.Typer()
    for verb in (diff, inspect, label, list_scenes, mv, rm, upload):
        verb.register(app)
    return CliRunner().invoke(app, [str(argument) for argument in arguments], input=typed)


@pytest.fixture
def pit(tmp_path: Path) -> TinyScene:
    scene = write_tiny_scene(tmp_path / "pit", stable_ids=(4, 2, 9))
    WorkDirectory(tmp_path / ".pit.work")
    (tmp_path / ".pit.work" / "cloud.npy").write_bytes(bytes(5000))
    return scene


def test_list(pit: TinyScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    WorkDirectory(tmp_path / ".begun.work")
    with scene_locked(pit.path):
        shown = run("list", tmp_path)
    assert shown.exit_code == 0, shown.output
    lines = {line.split()[0]: line for line in shown.stdout.splitlines()}
    assert "unfinished" in lines["begun"]
    for text in (
        pit.manifest.version[:12],
        "288",
        "5 kB",
        "being built (process",
        "500000.0 8000000.0 500003.0 8000003.0 m",
        "CRS not stated",
    ):
        assert text in lines["pit"]
    monkeypatch.setattr(list_scenes, "_PIPED_WIDTH", 80)
    narrow = run("list", tmp_path).stdout
    assert "pit: 500000.0 8000000.0 500003.0 8000003.0 m, CRS not stated" in narrow
    assert max(map(len, narrow.splitlines())) <= 80
    [_, row] = json.loads(run("list", tmp_path, "--json").stdout)
    assert row["name"] == "pit"
    assert row["state"] == "published"
    assert row["version"] == pit.manifest.version
    assert (row["faces"], row["segments"]) == (288, 4)
    assert row["work"] == {"path": str(tmp_path / ".pit.work"), "bytes": 5000}
    assert row["extent"]["unit"] == "m"
    (tmp_path / "empty").mkdir()
    assert "no scene in" in run("list", tmp_path / "empty").stdout
    gone = run("list", tmp_path / "gone")
    assert gone.exit_code == 1
    assert "gone: no such folder" in gone.stderr


def test_mv(pit: TinyScene, tmp_path: Path) -> None:
    done = run("mv", pit.path, tmp_path / "well")
    assert done.exit_code == 0, done.output
    assert done.stdout == f"{pit.path} -> {tmp_path / 'well'}, with its work directory\n"
    assert run("mv", pit.path, tmp_path / "x").exit_code == 1
    with scene_locked(tmp_path / "well"):
        refused = run("mv", tmp_path / "well", tmp_path / "x")
    assert (refused.exit_code, "another build of" in refused.stderr) == (1, True)


def test_rm_asks_and_says_what_is_free(pit: TinyScene, tmp_path: Path) -> None:
    other = write_tiny_scene(tmp_path / "other", seed=1)
    refused = run("rm", pit.path, other.path)
    assert refused.exit_code == 2
    assert "nobody to ask" in refused.stderr
    assert "--yes" in refused.stderr
    # All or nothing.
    assert run("rm", pit.path, tmp_path / "nothing", "--yes").exit_code == 1
    assert validate_scene(pit.path) == validate_scene(other.path) == []
    done = run("rm", pit.path, "--work", "--yes")
    assert done.stdout == f"removed {pit.path}: only its work directory (5 kB), 5 kB freed\n"
    done = run("rm", pit.path, other.path, "--yes")
    assert done.exit_code == 0
    assert done.stdout.splitlines()[-1].endswith(" freed in all")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("typed", "status"), [("n\n", 1), ("y\n", 0)])
def test_rm_on_a_terminal(
    pit: TinyScene, monkeypatch: pytest.MonkeyPatch, typed: str, status: int
) -> None:
    monkeypatch.setattr(rm, "_is_terminal", lambda: True)
    done = run("rm", pit.path, typed=typed)
    assert done.exit_code == status
    assert "and its work directory (5 kB)" in done.stdout
    assert pit.path.exists() == bool(status)


def test_diff(pit: TinyScene, tmp_path: Path) -> None:
    same = run("diff", pit.path, pit.path)
    assert (same.exit_code, same.stdout) == (
        0,
        f"the same: version {pit.manifest.version[:12]}\n",
    )
    other = write_tiny_scene(tmp_path / "other", seed=1, stable_ids=(4, 7, 9))
    shown = run("diff", pit.path, other.path)
    assert shown.exit_code == 1, shown.output
    for text in (
        "a client with A in its cache loads", "heights: -0.", "for volumes of cut",
        "regions: 2 kept, 2",
    ):  # fmt: skip
        assert text in shown.stdout
    facts = json.loads(run("diff", pit.path, other.path, "--json").stdout)
    assert facts["segments"]["changed"]["segments"] == 4
    assert facts["options"]["seed"] == [0, 1]
    assert facts["heights"]["lowest_m"] < 0 < facts["heights"]["highest_m"]
    assert (set(facts["heights"]) & {"cut_m3", "fill_m3"}, facts["change"]) == (set(), None)
    without = json.loads(run("diff", pit.path, other.path, "--json", "--no-heights").stdout)
    assert (without["heights"], without["heights_problem"]) == (None, "not asked for")
    for arguments in ((pit.path, tmp_path / "nothing"), (pit.path,), ("s3://b/pit",)):
        assert run("diff", *arguments).exit_code == 2


def test_diff_of_the_last_build(pit: TinyScene) -> None:
    write_tiny_scene(pit.path, stable_ids=(4, 2, 9), changed=True)
    shown = run("diff", pit.path)
    assert shown.exit_code == 1, shown.output
    assert "heights: not compared, only the manifest of the published version" in shown.stdout
    relabelled = write_tiny_scene(pit.path, stable_ids=(4, 2, 8), changed=True)
    assert "heights: the same, every segment is kept" in run("diff", relabelled.path).stdout
    write_tiny_scene(pit.path, stable_ids=(4, 2, 9))
    write_tiny_scene(pit.path, stable_ids=(4, 2, 9), changed=True)
    facts = json.loads(run("diff", pit.path, "--json").stdout)
    assert facts["segments"]["kept"]["segments"] == 3
    assert facts["a"]["version"] == pit.manifest.version[:12]


def test_one_slash_is_no_path(tmp_path: Path, pit: TinyScene) -> None:
    for arguments in (
        ("list", "s3:/b/scenes"),
        ("mv", "s3:/b/pit", tmp_path / "x"),
        ("mv", pit.path, "s3:/b/pit"),
        ("rm", "s3:/b/pit", "--yes"),
        ("rm", "s3:/b/pit", "--work", "--yes"),
        ("diff", "s3:/b/pit", pit.path),
        ("inspect", "s3:/b/pit"),
        ("label", "s3:/b/pit"),
    ):
        done = run(*arguments)
        assert done.exit_code in {1, 2}
        assert "s3://b/" in done.stderr
        assert "s3:/b" not in done.stderr.replace("s3://", "")
        assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("verb", ["list", "rm", "mv", "diff", "inspect", "label", "upload"])
def test_a_dead_endpoint_is_said_within_seconds(verb: str, pit: TinyScene) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        endpoint = f"http://127.0.0.1:{probe.getsockname()[1]}"
    more = {"rm": ["--yes"], "mv": ["s3://b/x"], "diff": [pit.path]}.get(verb, [])
    arguments = [pit.path, "s3://b/pit"] if verb == "upload" else ["s3://b/pit", *more]
    began_s = time.monotonic()
    with s3_environment(endpoint):
        done = run(verb, *arguments)
    assert time.monotonic() - began_s < 8.0
    assert done.exit_code == (2 if verb == "diff" else 1)
    assert f"nothing answers at {endpoint}, expected the storage's service" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.fixture
def proxy(moto: str) -> Iterator[FaultProxy]:
    with FaultProxy(moto) as between, s3_environment(between.url):
        yield between


def test_all_of_it_in_object_storage(proxy: FaultProxy, pit: TinyScene, tmp_path: Path) -> None:
    url = f"s3://scenes/{tmp_path.name}"
    sent = run("upload", pit.path, f"{url}/pit")
    assert sent.exit_code == 0, sent.output
    assert sent.stderr == ""  # no terminal, no progress
    assert ": version " in sent.stdout
    assert "5 files, " in sent.stdout
    [row] = json.loads(run("list", url, "--json").stdout)
    assert (row["name"], row["version"], row["work"]) == ("pit", pit.manifest.version, None)
    assert run("diff", pit.path, f"{url}/pit").exit_code == 0
    shown = run("inspect", f"{url}/pit", "--json")
    assert json.loads(shown.stdout)["version"] == pit.manifest.version
    table = run("label", f"{url}/pit", "--export", "-")
    assert table.stdout.startswith("stable_id,label")
    assert "set labels in the scene's folder" in run("label", f"{url}/pit", tmp_path / "l").stderr
    moved = run("mv", f"{url}/pit", f"{url}/old/")
    assert moved.stdout == f"{url}/pit -> {url}/old/pit, copied\n"
    assert run("rm", f"{url}/old/pit").exit_code == 2
    removed = run("rm", f"{url}/old/pit", "--yes")
    assert removed.exit_code == 0, removed.output
    assert f"removed {url}/old/pit, " in removed.stdout
    for gone in (("rm", "--yes"), ("diff", pit.path), ("inspect",), ("label",)):
        verb, *rest = gone
        done = run(verb, *rest, f"{url}/old/pit")
        assert done.exit_code in {1, 2}
        assert f"no scene at {url}/old/pit" in done.stderr
