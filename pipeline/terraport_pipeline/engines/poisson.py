"""Screened Poisson surface reconstruction by PoissonRecon, as pycolmap ships it.

M. Kazhdan and H. Hoppe, "Screened Poisson surface reconstruction", ACM Transactions on Graphics
32(3), 2013.

Files in, files out, one child process per reconstruction (see
:mod:`terraport_pipeline.engines.poisson_child`). The solver reports no progress; the caller's
`tick` is called with the seconds gone by.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

from terraport_payload.types import Float32, Int32
from terraport_pipeline.errors import EngineError, ResourceError

__all__ = ["Forecast", "depth_for", "forecast", "reconstruct"]

POINT_WEIGHT = 4.0
"""Weight of passing through the samples against smoothness, PoissonRecon's own default too. 2 lies
farther from samples held out, 8 begins to follow the noise (docs/decisions/poisson-solver.md)."""

SCALE = 1.1
"""The solver's cube is this much wider than the cloud's longest side."""

DEEPEST = 13
"""Octree depth of the detail that is not passed unless it is asked for, the thesis's own."""

_FACES_PER_CELL = 2.8
"""Faces per cell of the cube's cross section that the surface passes (measured on six surveys,
depths 9 to 11: 2.5 to 2.9)."""

_FACES_PER_POINT = 6.6
"""Faces per sample at which finer cells add no more (measured: 4.1 to 6.6)."""

_BASE_BYTES = 160 * 2**20
"""A child's memory before it solves: interpreter, pycolmap, buffers."""

_BYTES_PER_FACE = 280
"""Peak memory per face made (measured 240 to 255, depths 9 to 11), with a tenth on top."""

_BYTES_PER_POINT = 35
"""Peak memory per sample while the tree is built."""

_SECONDS_PER_FACE = 19e-6
_SECONDS_PER_POINT = 4e-6
"""One thread of this project's reference machine, nothing beside it: 5.3 M faces of 2.2 M points in
114 s, 1.6 M of 0.5 M in 35 s."""

_POLL_S = 0.1
_ATTEMPTS = 2
"""A second attempt costs minutes, a failed build hours: crashes of the solver are rare and not
repeatable."""


@dataclass(frozen=True, slots=True)
class Forecast:
    """What one reconstruction is expected to cost."""

    faces: int
    memory_bytes: int
    seconds: float


def depth_for(asked: int | None, extent_m: float, spacing_m: float) -> int:
    """Octree depth at which a cell is about one sample spacing, at most `asked`.

    Finer cells add no detail, only the noise of single samples. Where no depth was asked for, it is
    at most `DEEPEST`.

    Examples
    --------
    >>> depth_for(13, extent_m=400.0, spacing_m=0.4)
    10
    """
    useful = round(float(np.log2(max(SCALE * extent_m / spacing_m, 2.0))))
    return max(1, min(DEEPEST if asked is None else asked, useful))


def forecast(point_count: int, depth: int, extent_m: float, area_m2: float) -> Forecast:
    """Estimate the cost of a reconstruction.

    Parameters
    ----------
    point_count : int
    depth : int
        Octree depth.
    extent_m : float
        Longest side of the cloud's box.
    area_m2 : float
        Area of the sampled surface: points times the square of the areal spacing.

    Returns
    -------
    Forecast
        On the surveys it was fitted to (0.5 to 5 M points, depths 9 to 11) memory comes out 1.0 to
        1.25 times what was used, faces within an eighth either way. Seconds are those of an idle
        core; another machine, or a loaded one, takes its own.
    """
    cell_m = SCALE * extent_m / 2**depth
    by_cells = _FACES_PER_CELL * area_m2 / cell_m**2
    faces = int(min(by_cells, _FACES_PER_POINT * point_count)) + 1000
    memory = _BASE_BYTES + _BYTES_PER_FACE * faces + _BYTES_PER_POINT * point_count
    seconds = 1.5 + _SECONDS_PER_FACE * faces + _SECONDS_PER_POINT * point_count
    return Forecast(faces, memory, seconds)


def reconstruct(
    points: Float32,
    normals: Float32,
    depth: int,
    directory: Path,
    *,
    max_memory_bytes: int | None = None,
    point_weight: float = POINT_WEIGHT,
    tick: Callable[[float], None] = lambda _: None,
) -> tuple[Float32, Int32]:
    """Reconstruct a cloud.

    Parameters
    ----------
    points, normals : ndarray of shape (N, 3), float32
        Metres, unit; scene frame.
    depth : int
        Of the octree.
    directory : Path
        For the PLY files; they are deleted before this returns or raises.
    max_memory_bytes : int, optional
        The child is stopped when it passes this.
    point_weight : float
    tick : callable
        Called ten times a second with the seconds since the last call.

    Returns
    -------
    vertices : ndarray of shape (V, 3), float32
        As `points`.
    faces : ndarray of shape (F, 3), int32
        A closed surface: trimming is the caller's.

    Raises
    ------
    EngineError
        The child failed twice; the message ends with what it printed.
    ResourceError
        More memory than allowed, or the disk is full.
    """
    source, target = directory / "poisson-in.ply", directory / "poisson-out.ply"
    try:
        _write_ply(source, points, normals)
        _run(_Job(source, target, depth, point_weight), max_memory_bytes, tick)
        return _read_ply(target)
    finally:
        for path in (source, target, target.with_suffix(".log"), target.with_suffix(".part.ply")):
            path.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class _Job:
    source: Path
    target: Path
    depth: int
    point_weight: float

    def command(self) -> list[str]:
        module = "terraport_pipeline.engines.poisson_child"
        numbers = [str(self.depth), repr(self.point_weight), str(os.getpid())]
        return [sys.executable, "-m", module, str(self.source), str(self.target), *numbers]


def _run(job: _Job, max_memory_bytes: int | None, tick: Callable[[float], None]) -> None:
    """Run a child to its end, again once if it fails."""
    for _ in range(_ATTEMPTS):
        with _child(job) as process:
            _wait(process, max_memory_bytes, tick)
        if job.target.is_file():
            return
    _raise_failure(job, process)


@contextlib.contextmanager
def _child(job: _Job) -> Iterator[subprocess.Popen[bytes]]:
    """Start a child; whatever happens, it is gone at the end."""
    with job.target.with_suffix(".log").open("wb") as log:
        process = subprocess.Popen(
            job.command(), stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT
        )
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()
            process.wait()


def _wait(
    process: subprocess.Popen[bytes],
    max_memory_bytes: int | None,
    tick: Callable[[float], None],
) -> None:
    last = time.monotonic()
    while process.poll() is None:
        time.sleep(_POLL_S)
        now = time.monotonic()
        tick(now - last)
        last = now
        used = _resident_bytes(process.pid)
        if max_memory_bytes is not None and used > max_memory_bytes:
            raise ResourceError(
                f"reconstruction uses {used / 2**30:.1f} GiB, allowed are "
                f"{max_memory_bytes / 2**30:.1f} GiB (--max-memory); lower --detail-depth, "
                "or thin the survey with --max-points"
            )


def _resident_bytes(pid: int) -> int:
    try:
        return int(psutil.Process(pid).memory_info().rss)
    except psutil.Error:
        return 0


def _raise_failure(job: _Job, process: subprocess.Popen[bytes]) -> None:
    output = job.target.with_suffix(".log").read_bytes()[-2000:].decode("utf-8", "replace").strip()
    if process.returncode == -9:
        raise ResourceError(
            f"the system killed the reconstruction at depth {job.depth} (out of memory?); "
            "lower --detail-depth, or thin the survey with --max-points"
        )
    if "No space left" in output or "File too large" in output:
        raise ResourceError(
            f"no space left in {job.target.parent} for the reconstruction; "
            "free some, or give --work another disk"
        )
    raise EngineError(
        f"Poisson reconstruction at depth {job.depth} ended with exit code {process.returncode}, "
        f"{_ATTEMPTS} times; it printed: {output or 'nothing'}"
    )


def _write_ply(path: Path, points: Float32, normals: Float32) -> None:
    names = ("x", "y", "z", "nx", "ny", "nz")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in names] + ["end_header", ""]
    with path.open("wb") as file:
        file.write("\n".join(header).encode("ascii"))
        # Not `tofile`: it tells a full disk without its errno.
        file.write(np.hstack([points, normals]).astype("<f4", copy=False).data)


def _read_ply(path: Path) -> tuple[Float32, Int32]:
    """Read what PoissonRecon writes: float positions first, then lists of three int indices."""
    with path.open("rb") as file:
        # (1) The header, within bounds.
        header: list[str] = []
        while not header or header[-1] != "end_header":
            line = file.readline(256)
            if not line.endswith(b"\n") or len(header) > 64:
                raise EngineError(f"{path.name}: no PLY header within {file.tell()} bytes")
            header.append(line.decode("ascii", "replace").strip())
        sizes = {"char": 1, "uchar": 1, "short": 2, "ushort": 2, "int": 4, "uint": 4, "float": 4}
        count = {row.split()[1]: int(row.split()[2]) for row in header if row.startswith("element")}
        stride = sum(
            sizes[row.split()[1]]
            for row in header
            if row.startswith("property") and not row.startswith("property list")
        )
        if header[1] != "format binary_little_endian 1.0" or (
            "property list int int vertex_indices" not in header
        ):
            raise EngineError(f"{path.name}: unexpected PLY layout {header[1:]}")
        # (2) Positions stand first in a vertex; each face is a count, always 3, and three
        # indices.
        raw = np.fromfile(file, dtype=np.uint8, count=stride * count["vertex"])
        lists = np.fromfile(file, dtype="<i4", count=4 * count["face"])
    if len(raw) != stride * count["vertex"] or len(lists) != 4 * count["face"]:
        raise ResourceError(
            f"{path} is shorter than its header says: no space left there? free some, or give "
            "--work another disk"
        )
    lists = lists.reshape(-1, 4)
    if len(lists) and not (lists[:, 0] == 3).all():
        raise EngineError(f"{path.name}: holds faces that are not triangles")
    vertices = raw.reshape(-1, stride)[:, :12].copy().view("<f4").astype(np.float32)
    return vertices, np.ascontiguousarray(lists[:, 1:]).astype(np.int32)
