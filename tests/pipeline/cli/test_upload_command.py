"""``terraport upload`` and ``terraport validate`` of an address."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from s3_servers import s3_environment
from store.tiny_scene import TinyScene, write_tiny_scene
from typer.testing import CliRunner, Result

from terraport_pipeline.cli import upload, validate


@pytest.fixture(autouse=True)
def s3(moto: str) -> Iterator[str]:
    with s3_environment():
        yield moto


@pytest.fixture
def tiny(tmp_path: Path) -> TinyScene:
    return write_tiny_scene(tmp_path / "tiny")


def run(*arguments: object) -> Result:
    app = typer.Typer()
    upload.register(app)
    validate.register(app)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_upload_again_prune_and_validate(
    s3: str, tiny: TinyScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = f"s3://scenes/{tmp_path.name}/tiny"
    done = run("upload", tiny.path, url, "--endpoint", s3)
    assert done.exit_code == 0, done.output
    assert f"{url}: version {tiny.manifest.version[:12]}" in done.stdout
    again = run("upload", tiny.path, url, "--endpoint", s3)
    assert "0 bytes sent, 5 files were there" in again.stdout
    for seed in (1, 2):
        write_tiny_scene(tmp_path / "tiny", seed=seed)
        done = run("upload", tiny.path, url, "--endpoint", s3, "--prune")
    assert f"removed {tiny.manifest.folder}" in done.stdout
    monkeypatch.setenv("AWS_ENDPOINT_URL", s3)
    checked = run("validate", url, "--rays", 0)
    assert checked.exit_code == 0, checked.output
    assert "tiny" in checked.stdout


def test_what_cannot_be_is_one_line(s3: str, tiny: TinyScene, tmp_path: Path) -> None:
    for arguments, text in (
        ((tiny.path, "scenes/tiny"), "is a path, expected an address like s3://"),
        ((tmp_path, "s3://scenes/x"), "no scene at"),
        ((tiny.path, "s3:/scenes/tiny"), "expected an address like s3://scenes/tiny"),
        (("s3://scenes/tiny", "s3://scenes/x"), "s3://scenes/tiny was taken for a path"),
        ((tiny.path, "s3://no-such-bucket/x"), "expected a bucket that exists"),
        (
            (tiny.path, "s3://scenes/x", "--endpoint", "minio:9000"),
            "s3://scenes/x: cannot be used: the endpoint is 'minio:9000', expected one like http://",
        ),
    ):
        done = run("upload", "--endpoint", s3, *arguments)
        assert done.exit_code == 1
        assert text in done.stderr
        assert len(done.stderr.splitlines()) == 1
