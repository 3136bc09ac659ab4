"""A failure that nobody foresaw: no trace for the user, finished stages kept, a way to go on."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
import typer
from pipeline.flat_photos import write_field
from typer.testing import CliRunner

from terraport_pipeline.cli import build, demo, report
from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.report import report as report_writer
from terraport_pipeline.stages import atlas_maker, clean, texture
from terraport_pipeline.stages.tiles import tiled_views
from terraport_pipeline.unforeseen import FAILURE_NAME
from terraport_pipeline.workflow import reconstruct_step, runner
from terraport_store.validate import validate_scene

SMALL = ("--min-faces", "300", "--max-faces", "1500", "--base-faces", "600", "--no-report")


def run(*arguments: object) -> tuple[int, str]:
    app = typer.Typer()
    for command in (build, demo, report):
        command.register(app)
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A survey with photos; never modified."""
    folder = tmp_path_factory.mktemp("field")
    write_field(folder)
    return folder


@pytest.fixture
def broken() -> Callable[[object, str, Exception], AbstractContextManager[None]]:
    """Make a function of a module raise, for a while."""

    def breaking(module: object, name: str, error: Exception) -> AbstractContextManager[None]:
        def fail(*_: object, **__: object) -> None:
            raise error

        patch = pytest.MonkeyPatch()

        class Broken(AbstractContextManager[None]):
            def __enter__(self) -> None:
                patch.setattr(module, name, fail)

            def __exit__(self, *_: object) -> None:
                patch.undo()

        return Broken()

    return breaking


def test_a_kernel_that_fails_names_the_stage_and_the_same_command_goes_on(
    field: Path, tmp_path: Path, broken: Callable[..., AbstractContextManager[None]]
) -> None:
    scene = tmp_path / "scene"
    command = ("build", field / "field.xyz", "-o", scene, "--photos", field / "photos", *SMALL)
    with broken(atlas_maker, "pack_charts", ZeroDivisionError("division by zero")):
        code, output = run(*command)
    log = tmp_path / ".scene.work" / FAILURE_NAME
    assert code == 1
    assert "Traceback" not in output
    assert (
        "error: stage texture-base failed in a way that nobody foresaw "
        "(ZeroDivisionError: division by zero)"
    ) in output
    assert "finished stages (read, clean, reconstruct, segment) are kept" in output
    assert "the same command goes on after them" in output
    assert "without --photos" in output
    assert f"please report it with {log}" in output
    log_text = log.read_text(encoding="utf-8")
    assert "Traceback" in log_text
    assert "pack_charts" in log_text
    assert not scene.exists()
    code, output = run(*command)
    assert code == 0, output
    assert output.count("taken up") == 4
    assert validate_scene(scene) == []


def test_a_published_scene_stands_when_the_next_build_fails(
    field: Path, tmp_path: Path, broken: Callable[..., AbstractContextManager[None]]
) -> None:
    scene = tmp_path / "scene"
    assert run("build", field / "field.xyz", "-o", scene, *SMALL)[0] == 0
    before = (scene / "scene.json").read_bytes()
    with broken(clean, "run", KeyError("normals")):
        code, output = run(
            "build", field / "field.xyz", "-o", scene, *SMALL, "--outlier-ratio", 2.5
        )
    assert code == 1
    assert "stage clean failed in a way that nobody foresaw (KeyError: 'normals')" in output
    assert "(read) are kept" in output
    assert (scene / "scene.json").read_bytes() == before
    assert validate_scene(scene) == []


def test_refused_memory_is_said_as_such(
    field: Path, tmp_path: Path, broken: Callable[..., AbstractContextManager[None]]
) -> None:
    with broken(clean, "run", MemoryError("4 GiB")):
        code, output = run("build", field / "field.xyz", "-o", tmp_path / "scene", *SMALL)
    assert code == 1
    assert "error: stage clean was refused memory (MemoryError: 4 GiB)" in output
    assert "--max-points" in output


def fail_job(_: object) -> None:
    """Stand for the work on a tile, in a process of its own."""
    raise IndexError("row 7")


def test_a_tile_that_fails_in_another_process_does_so_as_plainly(
    field: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tmp_path / "scene"
    monkeypatch.setattr(reconstruct_step, "TilePool", lambda _, cluster: TilePool(1, cluster))
    monkeypatch.setattr(runner, "_keep_alone", fail_job)
    code, output = run("build", field / "field.xyz", "-o", scene, *SMALL)
    assert code == 1
    assert "Traceback" not in output
    assert "stage solve failed in a way that nobody foresaw (IndexError: row 7)" in output
    assert not scene.exists()
    log = (tmp_path / ".scene.work" / FAILURE_NAME).read_text(encoding="utf-8")
    assert "in fail_job" in log  # the trace of the process that did it


def test_a_tiles_textures_that_fail_do_so_as_plainly(
    field: Path, tmp_path: Path, broken: Callable[..., AbstractContextManager[None]]
) -> None:
    scene = tmp_path / "scene"
    with broken(tiled_views, "banded", IndexError("row 7")):
        code, output = run(
            "build", field / "field.xyz", "-o", scene, "--photos", field / "photos", *SMALL
        )
    assert code == 1
    assert "Traceback" not in output
    assert "stage texture-views failed in a way that nobody foresaw (IndexError: row 7)" in output
    assert not scene.exists()


def test_a_report_that_fails_leaves_the_scene(
    field: Path, tmp_path: Path, broken: Callable[..., AbstractContextManager[None]]
) -> None:
    scene = tmp_path / "scene"
    with broken(report_writer, "write_report", TypeError("no picture")):
        code, output = run("build", field / "field.xyz", "-o", scene, *SMALL[:-1])
    assert code == 1
    assert "the report failed in a way that nobody foresaw (TypeError: no picture)" in output
    assert f"{scene} is published and whole" in output
    assert validate_scene(scene) == []


def test_another_command_that_fails_keeps_its_trace_too(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    broken: Callable[..., AbstractContextManager[None]],
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with broken(report_writer, "write_report", AssertionError("never")):
        code, output = run("report", tmp_path)
    assert code == 1
    assert "Traceback" not in output
    (log,) = tmp_path.glob("terraport-failure-*.log")
    assert str(log) in output
    assert "AssertionError: never" in log.read_text(encoding="utf-8")


def test_a_demo_that_fails_keeps_what_is_finished(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    broken: Callable[..., AbstractContextManager[None]],
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with broken(texture, "texture_base", RuntimeError("out of luck")):
        code, output = run("demo", "--points", "20k", "--no-photos", "--no-serve", "--no-open")
        assert code == 0, output  # nothing to texture
        assert not list(tmp_path.iterdir())
    with broken(clean, "run", RuntimeError("out of luck")):
        code, output = run("demo", "--points", "20k", "--no-photos", "--no-serve", "--no-open")
    assert code == 1
    (folder,) = tmp_path.glob("terraport-demo-*")
    assert f"terraport demo --keep {folder} goes on with it" in output
    assert (folder / "work" / FAILURE_NAME).exists()
