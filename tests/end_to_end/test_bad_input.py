"""Bad surveys on the command line: a clear error, exit code 1, and nothing half-written."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
from command_line import Built, run_terraport

Writer = Callable[[Path, Path], Path]


def xyz(folder: Path, rows: np.ndarray) -> Path:
    path = folder / "bad.xyz"
    np.savetxt(path, rows, fmt="%.3f")
    return path


def empty(folder: Path, good: Path) -> Path:
    path = folder / "bad.laz"
    path.write_bytes(b"")
    return path


def truncated(folder: Path, good: Path) -> Path:
    path = folder / "bad.laz"
    path.write_bytes(good.read_bytes()[:-200_000])
    return path


def not_a_survey(folder: Path, good: Path) -> Path:
    path = folder / "bad.laz"
    path.write_bytes(b"PK\x03\x04 this is a zip, not a point cloud" * 40)
    return path


def all_nan(folder: Path, good: Path) -> Path:
    path = folder / "bad.ply"
    rows = "\n".join("nan nan nan" for _ in range(100))
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 100\nproperty float x\nproperty float y\n"
        f"property float z\nend_header\n{rows}\n"
    )
    return path


def three_points(folder: Path, good: Path) -> Path:
    return xyz(folder, np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]]))


def one_line(folder: Path, good: Path) -> Path:
    along = np.linspace(0, 100, 500)
    return xyz(folder, np.stack([along, 2 * along, along], axis=1))


def one_place(folder: Path, good: Path) -> Path:
    return xyz(folder, np.tile([[500000.0, 4000000.0, 100.0]], (500, 1)))


@pytest.mark.parametrize(
    ("write", "says"),
    [
        (empty, "empty"),
        (truncated, "trunc|ends|short|point"),
        (not_a_survey, "ZIP archive"),
        (all_nan, "finite|NaN|nan"),
        (three_points, "3 points|points"),
        (one_line, "one plane"),
        (one_place, "1 different point"),
    ],
)
def test_a_bad_survey_is_refused(write: Writer, says: str, tmp_path: Path, built: Built) -> None:
    survey = write(tmp_path, built.survey)
    scene = tmp_path / "scenes" / "bad"
    result = run_terraport("build", survey, "-o", scene)
    assert result.returncode == 1, result.stdout + result.stderr
    assert "error: " in result.stderr
    assert "Traceback" not in result.stderr
    assert any(word in result.stderr for word in says.split("|")), result.stderr
    assert not scene.exists()


def test_a_bad_survey_leaves_the_published_scene(tmp_path: Path, built: Built) -> None:
    before = {path: path.stat().st_mtime_ns for path in built.scene.rglob("*")}
    result = run_terraport(
        "build", truncated(tmp_path, built.survey), "-o", built.scene, "--work", tmp_path / "work"
    )
    assert result.returncode == 1
    assert {path: path.stat().st_mtime_ns for path in built.scene.rglob("*")} == before


def test_nan_rows_and_missing_colours_are_said_and_survived(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform(0, 40, (6000, 3))
    points[:, 2] = 3 * np.sin(points[:, 0] / 6) + 100
    points[::100] = np.nan
    path = tmp_path / "holes.ply"
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 6000\nproperty double x\n"
        "property double y\nproperty double z\nend_header\n"
    )
    path.write_bytes(header.encode() + points.astype("<f8").tobytes())
    result = run_terraport("build", path, "-o", tmp_path / "scene", "--min-faces", "200")
    assert result.returncode == 0, result.stderr
    output = result.stdout + result.stderr
    assert "60" in output
    assert "grey" in output
    assert (tmp_path / "scene" / "report.html").is_file()


def test_an_interrupted_build_goes_on_where_it_stopped(tmp_path: Path, built: Built) -> None:
    scene = tmp_path / "scenes" / "quarry"
    work = tmp_path / "work"
    command = [Path(sys.executable).with_name("terraport"), "build", built.survey, "--no-report"]
    process = subprocess.Popen(
        [*command, "-o", scene, "--work", work],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 120
    while not (work / "clean" / "stage.json").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    time.sleep(0.5)
    os.killpg(process.pid, signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    assert not (scene / "scene.json").exists()
    again = run_terraport("build", built.survey, "--no-report", "-o", scene, "--work", work)
    assert again.returncode == 0, again.stderr
    assert (scene / "scene.json").exists()


def test_ctrl_c_waits_for_no_thread() -> None:
    """Nor takes the interpreter down under it: compiled code in a thread cannot be interrupted."""
    command = """
import atexit, threading, time
from terraport.cli import lazy, main
atexit.register(print, "tidied")

def interrupted(verb):
    threading.Thread(target=time.sleep, args=(600,)).start()
    raise KeyboardInterrupt

lazy._load = interrupted
main()
"""
    result = subprocess.run(
        [sys.executable, "-c", command, "build", "pit.laz"],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 130, result.stderr
    assert result.stderr == "stopped\n"
    assert result.stdout == "tidied\n"


def test_grey_surveys_build(shared_data: Path, tmp_path: Path) -> None:
    """A COPC without colours, thinned."""
    result = run_terraport(
        "build",
        shared_data / "lone_star_geyser" / "lone-star.copc.laz",
        "-o",
        tmp_path / "geyser",
        "--no-report",
        "--max-points",
        "15k",
    )
    assert result.returncode == 0, result.stderr
    assert "grey" in result.stdout + result.stderr


def test_the_tiny_survey_with_colours_is_read(shared_data: Path) -> None:
    path = shared_data / "small_las" / "1.2-with-color.las"
    from terraport_pipeline.stages.read import read_survey

    survey = read_survey(path)
    las = laspy.read(path)
    expected = np.unique(np.asarray(las.xyz), axis=0)  # in an order that files do not decide
    np.testing.assert_allclose(np.unique(survey.points, axis=0), expected)
    assert survey.colours is not None
