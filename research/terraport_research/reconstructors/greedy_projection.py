"""Greedy projection triangulation: the program ``pcl_gp3_surface`` of the Point Cloud Library.

Z. C. Marton, R. B. Rusu and M. Beetz, "On fast surface reconstruction methods for large and noisy
point clouds", ICRA 2009. There is no maintained Python package; Debian and Ubuntu have the program.
It takes PCD and gives VTK, both without colour; its vertices are the samples in their order, so
nothing is lost.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import Int32
from terraport_pipeline.errors import EngineError
from terraport_research.reconstructors.contract import (
    Reconstructor,
    Samples,
    Surface,
    Work,
)

__all__ = ["GREEDY_PROJECTION", "PROGRAM"]

PROGRAM: Final = "pcl_gp3_surface"
RADIUS_SPACINGS: Final = 4.0
"""Longest edge; on noisy samples a smaller one leaves more holes."""
MU: Final = 3.0
"""Neighbours within this many times the nearest one's distance; the library's tutorial has 2.5."""

_TIMEOUT_S: Final = 600


def _missing() -> str | None:
    if shutil.which(PROGRAM):
        return None
    return f'program "{PROGRAM}" not found; apt-get install pcl-tools (Debian, Ubuntu)'


def _run(samples: Samples, work: Work) -> Surface:
    source, target = work.scratch / "samples.pcd", work.scratch / "surface.vtk"
    _write_pcd(source, samples)
    command = [PROGRAM, str(source), str(target)]
    command += ["-radius", repr(RADIUS_SPACINGS * samples.spacing_m), "-mu", repr(MU)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=_TIMEOUT_S, check=False)
    except FileNotFoundError as error:
        raise EngineError(str(_missing())) from error
    except subprocess.TimeoutExpired as error:
        raise EngineError(f"{PROGRAM} did not end within {_TIMEOUT_S} s") from error
    if done.returncode or not target.is_file():
        output = (done.stderr + done.stdout)[-500:].decode("utf-8", "replace").strip()
        raise EngineError(
            f"{PROGRAM} ended with exit code {done.returncode}; it printed: {output or 'nothing'}"
        )
    faces = _read_vtk(target, len(samples.points))
    return Surface(
        samples.points,
        _turned(faces, samples),
        np.arange(len(samples.points), dtype=np.int32),
        f"edges up to {RADIUS_SPACINGS:g} spacings",
    )


def _write_pcd(path: Path, samples: Samples) -> None:
    count = len(samples.points)
    rows = np.zeros((count, 7), "<f4")
    rows[:, :3], rows[:, 3:6] = samples.points, samples.normals
    header = (
        "VERSION 0.7\nFIELDS x y z normal_x normal_y normal_z curvature\nSIZE 4 4 4 4 4 4 4\n"
        f"TYPE F F F F F F F\nCOUNT 1 1 1 1 1 1 1\nWIDTH {count}\nHEIGHT 1\nPOINTS {count}\n"
        "DATA binary\n"
    )
    path.write_bytes(header.encode("ascii") + rows.tobytes())


def _read_vtk(path: Path, point_count: int) -> Int32:
    """Read the triangles of a legacy ASCII VTK file whose points are the samples."""
    text = path.read_text("ascii", "replace")
    words = text.partition("POINTS ")[2].split(maxsplit=1)
    if not words or words[0] != str(point_count):
        raise EngineError(
            f"{PROGRAM} gave {words[0] if words else 'no'} points for {point_count} samples; "
            "expected each of them"
        )
    count_and_size, _, rest = text.partition("\nPOLYGONS ")[2].partition("\n")
    if not count_and_size:
        return np.zeros((0, 3), np.int32)
    count, size = (int(word) for word in count_and_size.split())
    numbers = np.fromstring(rest, dtype=np.int64, count=size, sep=" ")
    if size != 4 * count or (numbers[::4] != 3).any():
        raise EngineError(f"{PROGRAM} gave polygons that are not triangles")
    return numbers.reshape(-1, 4)[:, 1:].astype(np.int32)


def _turned(faces: Int32, samples: Samples) -> Int32:
    """Faces counter-clockwise seen from where the normals point: the program does not care."""
    a, b, c = (samples.points[faces[:, k]].astype(np.float64) for k in range(3))
    out = np.einsum("fc,fc->f", np.cross(b - a, c - a), samples.normals[faces].sum(axis=1))
    turned = faces.copy()
    turned[out < 0] = faces[out < 0][:, [0, 2, 1]]
    return turned


GREEDY_PROJECTION: Final = Reconstructor(
    key="greedy-projection",
    title="Fast surface reconstruction",
    implementation="Point Cloud Library (pcl_gp3_surface)",
    thesis_used="Point Cloud Library",
    paper="Marton, Rusu and Beetz 2009",
    one_sheet=False,
    run=_run,
    missing=_missing,
)
