from __future__ import annotations

import stat
from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.errors import EngineError
from terraport_research.reconstructors import Samples, Work
from terraport_research.reconstructors.greedy_projection import GREEDY_PROJECTION, PROGRAM

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float32)
SAMPLES = Samples(
    POINTS,
    np.tile(np.array([0, 0, 1], np.float32), (4, 1)),
    np.zeros((4, 3), np.uint8),
    np.ones(4, np.float32),
    1.0,
)
VTK = """# vtk DataFile Version 3.0
vtk output
ASCII
DATASET POLYDATA
POINTS 4 float
0 0 0
1 0 0
0 1 0
1 1 0

VERTICES 4 8
1 0
1 1
1 2
1 3

POLYGONS 2 8
3 0 1 2
3 1 2 3
"""


def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, code: int = 0) -> Work:
    """Put a program on the path that gives this text."""
    (tmp_path / "text").write_text(text)
    path = tmp_path / PROGRAM
    path.write_text(f'#!/bin/sh\ncp {tmp_path}/text "$2"; echo it said this >&2; exit {code}\n')
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    return Work(tmp_path)


def test_faces_are_read_and_turned_to_the_normals(tmp_path: Path, monkeypatch) -> None:
    surface = GREEDY_PROJECTION.run(SAMPLES, program(tmp_path, monkeypatch, VTK))
    assert surface.faces.tolist() == [[0, 1, 2], [1, 3, 2]]  # the second was turned
    assert surface.sample is not None
    assert surface.sample.tolist() == [0, 1, 2, 3]
    pcd = (tmp_path / "samples.pcd").read_bytes()
    assert b"POINTS 4\nDATA binary\n" in pcd
    assert len(pcd.partition(b"binary\n")[2]) == 4 * 7 * 4


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        (VTK.replace("POINTS 4", "POINTS 3"), 0, "gave 3 points for 4 samples"),
        (VTK.replace("3 1 2 3", "4 1 2 3"), 0, "not triangles"),
        ("", 0, "gave no points"),
        (VTK, 7, "exit code 7; it printed: it said this"),
    ],
)
def test_what_the_program_does_wrong_is_told(tmp_path, monkeypatch, text, code, message) -> None:
    with pytest.raises(EngineError, match=message):
        GREEDY_PROJECTION.run(SAMPLES, program(tmp_path, monkeypatch, text, code))


def test_a_missing_program_is_named_with_its_package(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert GREEDY_PROJECTION.missing() == (
        'program "pcl_gp3_surface" not found; apt-get install pcl-tools (Debian, Ubuntu)'
    )
