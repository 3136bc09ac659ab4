"""How much memory a build needs, before it starts: whole, in tiles, or not at all.

The numbers are fits to measured builds (docs/topics/limits.md): bytes per sample and per face of
each stage, above what Python and its libraries take themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from terraport_pipeline.engines import poisson
from terraport_pipeline.geometry.tiles.tile_plan import TilePlan

__all__ = ["MemoryPlan", "TileForecast", "choose_depth", "forecast_tiles", "plan_memory"]

PROCESS_BYTES: Final = 240 * 2**20
"""Python with NumPy, SciPy, numba and their kernels."""

CLEAN_BYTES_PER_POINT: Final = 510
SEGMENT_BYTES_PER_FACE: Final = 325
TRIM_BYTES_PER_FACE: Final = 260
READ_BYTES_PER_POINT: Final = 75

FINISHING_BYTES_PER_FACE: Final = 325
"""After the solver: both surfaces trimmed, colours carried beside the base's thinning."""

_BESIDE_BYTES: Final = 150 * 2**20
"""The process of the base's last pass."""

_THINNING_BYTES_PER_FACE: Final = 160
_MAX_THINNING_BYTES: Final = 450 * 2**20
"""Of that thinning, which goes block by block: 1.76 GB at the peak of 1 M points, 3.93 of 5 M."""

_HELD_BYTES_PER_POINT: Final = 90
"""Bytes that each sample of a tile takes while its solver runs."""

PARENT_BYTES: Final = 900 * 2**20
"""The build itself while tiles are worked on: the thinned copy (0.2 GB), libraries, buffers. It
takes up to 1.4 GB earlier and later, when no tile is."""

LEAST_BYTES: Final = 1500 * 2**20
"""Cleaning the thinned copy."""

_TILE_DEPTHS: Final = range(8, 12)
"""A tile of depth 12 has 20 M faces: the overlap it saves is a tenth. One of depth 7 is nearly all
margin."""

_CELLS_PER_POINT: Final = 0.8
"""Cells per sample where nothing is known of the survey: the depth rule gives 0.5 to 2."""

_SIDE_BY_SIDE: Final = 2
"""Tiles worked on together when the depth is chosen, whatever the number of cores (the plan must
not depend on it). 50 M points of a quarry within 8 GiB: tiles of depth 9, of which seven fit, hold
every sample 2.4 times and solve for 2,950 CPU seconds; of depth 10, of which two fit, 1.5 times and
1,650."""


@dataclass(frozen=True, slots=True)
class TileForecast:
    """What the tiles of a plan are expected to cost."""

    tile_bytes: int
    """The most loaded tile, with its process."""
    workers: int
    """Number of tiles that are solved side by side."""
    faces: int
    seconds: float
    """CPU seconds of all tiles' solvers."""


@dataclass(frozen=True, slots=True)
class MemoryPlan:
    """Whether a build goes whole or in tiles, and the estimate that decides it."""

    tiled: bool
    whole_bytes: int
    """Peak of a build in one piece."""
    allowed_bytes: int
    why: str
    """A sentence for the user."""


def plan_memory(
    points: int,
    allowed_bytes: int,
    *,
    force: bool = False,
    detail_depth: int | None = None,
    extent_m: float | None = None,
    area_m2: float | None = None,
) -> MemoryPlan:
    """Decide how to build.

    Parameters
    ----------
    points : int
        Of the survey, after ``--max-points``.
    allowed_bytes : int
        For the whole process tree.
    force : bool
        Tiles in any case.
    detail_depth : int, optional
        As asked.
    extent_m, area_m2 : float, optional
        Longest side and plan area of the survey's box, where the header says them; they tell how
        deep the density goes. A usual density is assumed otherwise.

    Returns
    -------
    MemoryPlan
        In tiles when the whole would pass what is allowed.
    """
    if extent_m and area_m2:
        # A surface is rougher than its plan: a third more area.
        area = 4.0 / 3.0 * area_m2
        depth = poisson.depth_for(detail_depth, extent_m, (area / points) ** 0.5)
        solver = poisson.forecast(points, depth, extent_m, area)
    else:
        solver = poisson.forecast(points, 0, 1.0 / poisson.SCALE, _CELLS_PER_POINT * points)
    faces = solver.faces
    reading = READ_BYTES_PER_POINT * points
    cleaning = CLEAN_BYTES_PER_POINT * points
    solving = solver.memory_bytes + _HELD_BYTES_PER_POINT * points
    finishing = (
        _BESIDE_BYTES
        + min(_THINNING_BYTES_PER_FACE * faces, _MAX_THINNING_BYTES)
        + FINISHING_BYTES_PER_FACE * faces
    )
    segmenting = SEGMENT_BYTES_PER_FACE * faces
    whole = PROCESS_BYTES + max(reading, cleaning, solving, finishing, segmenting)
    reason = (
        f"a build in one piece needs about {whole / 2**30:.1f} GiB for {points:,} points and "
        f"{faces:,} faces, allowed are {allowed_bytes / 2**30:.1f} GiB"
    )
    if force:
        return MemoryPlan(True, whole, allowed_bytes, f"tiles were asked for ({reason})")
    if whole <= allowed_bytes:
        return MemoryPlan(False, whole, allowed_bytes, reason)
    return MemoryPlan(True, whole, allowed_bytes, f"{reason}: it goes in tiles")


def choose_depth(
    plan: Callable[[int], TilePlan],
    *,
    points: int,
    area_m2: float,
    max_memory_bytes: int,
    asked: int | None = None,
) -> TilePlan | None:
    """Choose the tiles that are solved soonest, two side by side where two fit.

    Larger tiles have less margin and so less work; but two that fit side by side may be done before
    a larger one alone.

    Returns
    -------
    TilePlan or None
        None when not even one of the smallest fits.
    """
    if asked is not None:
        return plan(asked)
    best: tuple[float, TilePlan] | None = None
    for depth in reversed(_TILE_DEPTHS):
        tried = plan(depth)
        fit = int((max_memory_bytes - PARENT_BYTES) // _tile_bytes(tried, points, area_m2))
        if fit < 1:
            continue
        work_s = sum(_solver(tried, int(load), points, area_m2).seconds for load in tried.points)
        time_s = work_s / min(fit, _SIDE_BY_SIDE)
        if best is None or time_s < best[0]:
            best = time_s, tried
        if fit >= _SIDE_BY_SIDE:
            break  # smaller ones only have more margin
    return None if best is None else best[1]


def forecast_tiles(
    plan: TilePlan, points: int, area_m2: float, max_memory_bytes: int, threads: int
) -> TileForecast:
    """Forecast the cost of a plan's tiles and how many run side by side."""
    need = _tile_bytes(plan, points, area_m2)
    fit = max(1, int((max_memory_bytes - PARENT_BYTES) // need))
    each = [_solver(plan, int(load), points, area_m2) for load in plan.points]
    return TileForecast(
        need,
        min(fit, threads, plan.count),
        sum(forecast.faces for forecast in each),
        sum(forecast.seconds for forecast in each),
    )


def _solver(plan: TilePlan, load: int, points: int, area_m2: float) -> poisson.Forecast:
    extent_m = plan.shape.side * plan.lattice.cell_m / poisson.SCALE
    return poisson.forecast(load, plan.shape.depth, extent_m, area_m2 * load / points)


def _tile_bytes(plan: TilePlan, points: int, area_m2: float) -> int:
    load = int(plan.points.max())
    solver = _solver(plan, load, points, area_m2)
    cleaning = CLEAN_BYTES_PER_POINT * load
    solving = solver.memory_bytes + _HELD_BYTES_PER_POINT * load
    trimming = TRIM_BYTES_PER_FACE * solver.faces + _HELD_BYTES_PER_POINT * load
    return PROCESS_BYTES + max(cleaning, solving, trimming)
