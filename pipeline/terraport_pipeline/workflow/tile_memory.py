"""How much memory a build needs, before it starts, and the tiles that follow from it.

The numbers are fits to measured builds (docs/topics/limits.md): bytes per sample and per face of
each stage, above what Python and its libraries take themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from terraport_pipeline.engines import poisson
from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.geometry.regions.engine_options import BORDERS_SIZE_M
from terraport_pipeline.geometry.tiles.tile_plan import TilePlan
from terraport_pipeline.options.regions import Options
from terraport_pipeline.stages.region_engine import border_segmenter, sized
from terraport_pipeline.stages.tiles.tile_engines import CELL_BYTES

__all__ = [
    "TileForecast",
    "WholeForecast",
    "cell_bytes",
    "check_cells",
    "choose_plan",
    "count_cells",
    "forecast_tiles",
    "forecast_whole",
    "tiles_fit",
]

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

_LEAST_CELL_SHARE: Final = 0.25
"""Share of the allowed memory that cells of regions may always take: for a small survey the rest of
the build takes less than ``PARENT_BYTES``."""

_TILE_DEPTHS: Final = range(8, 11)
"""Two tiles of depth 10 fit into 4 GiB where the ground is no rougher than 1.5 times its plan (and
into 7 GiB at three times), so machines with as much or more plan the same tiles, and publish the
same bytes. One of depth 7 is nearly all margin."""

_SINGLE_DEPTHS: Final = range(7, 21)
"""Of a tile that holds the whole survey; the widest has a million cells along a side."""

_TILE_SECONDS: Final = 3.0
"""What every tile takes beside its solver: a process, its margin cleaned, the join, the passes."""

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
class WholeForecast:
    """What a survey is expected to take as one tile."""

    points: int
    faces: int
    memory_bytes: int
    """At the peak."""

    def __str__(self) -> str:
        return (
            f"about {self.memory_bytes / 2**30:.1f} GiB for {self.points:,} points and "
            f"{self.faces:,} faces"
        )


def forecast_whole(
    points: int,
    *,
    detail_depth: int | None = None,
    extent_m: float | None = None,
    area_m2: float | None = None,
) -> WholeForecast:
    """Forecast by a survey's headers what it takes as one tile.

    Parameters
    ----------
    points : int
        Of the survey, after ``--max-points``.
    detail_depth : int, optional
        As asked.
    extent_m, area_m2 : float, optional
        Longest side and plan area of the survey's box, where the header says them; they tell how
        deep the density goes. A usual density is assumed otherwise.
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
    return WholeForecast(points, faces, whole)


def choose_plan(
    plan: Callable[[int], TilePlan],
    *,
    points: int,
    area_m2: float,
    max_memory_bytes: int,
    asked: int | None = None,
    in_one_piece: str | None = None,
) -> TilePlan:
    """Choose the tiles that are solved soonest by two workers.

    Larger tiles have less margin and so less work; but of a single one a second worker has nothing,
    and two that fit side by side may be done before a larger one alone. The choice does not depend
    on the number of cores, for the published bytes do on the plan.

    Parameters
    ----------
    plan : callable
        Plans tiles of a depth.
    points : int
        Of the survey.
    area_m2 : float
        Of its surface.
    max_memory_bytes : int
    asked : int, optional
        Depth of the tiles, whatever they take.
    in_one_piece : str, optional
        What needs a single tile, for the message where that cannot be.

    Raises
    ------
    ResourceError
        Not even one of the smallest fits; the single one does not.
    OptionError
        The depth that was asked for makes several tiles of what must be one.
    """
    # (1) What was asked for.
    way_out = "use --engine means and colour, which go by tiles, or thin the survey (--max-points)"
    if asked is not None:
        tried = plan(asked)
        if in_one_piece and tried.count > 1:
            raise OptionError(
                f"{in_one_piece} with {tried.count} tiles of depth {asked}; expected one: leave "
                f"out --tile-depth, or {way_out}"
            )
        return tried
    # (2) A single tile, as small as holds everything.
    if in_one_piece:
        whole = next(tried for depth in _SINGLE_DEPTHS if (tried := plan(depth)).count == 1)
        need = _tile_bytes(whole, points, area_m2)
        if not tiles_fit(whole, points, area_m2, max_memory_bytes):
            raise ResourceError(
                f"{in_one_piece} needs the surface in one piece, about "
                f"{(need + PARENT_BYTES) / 2**30:.1f} GiB; allowed are "
                f"{max_memory_bytes / 2**30:.1f} GiB: raise --max-memory, or {way_out}"
            )
        return whole
    # (3) Of those that fit, the plan that two workers are done with first.
    best: tuple[float, TilePlan] | None = None
    for depth in _TILE_DEPTHS:  # of equal ones the smallest: a cube that is filled is solved better
        tried = plan(depth)
        fit = int((max_memory_bytes - PARENT_BYTES) // _tile_bytes(tried, points, area_m2))
        if fit < 1:
            continue
        each_s = [
            _TILE_SECONDS + _solver(tried, int(load), points, area_m2).seconds
            for load in tried.points
        ]
        time_s = max(sum(each_s) / min(fit, _SIDE_BY_SIDE), *each_s)
        if best is None or time_s < best[0]:
            best = time_s, tried
    if best is None:
        raise ResourceError(
            f"{max_memory_bytes / 2**30:.1f} GiB are too little even for the smallest tile; raise "
            "--max-memory to 2G or more"
        )
    return best[1]


def tiles_fit(plan: TilePlan, points: int, area_m2: float, max_memory_bytes: int) -> bool:
    """Whether at least one tile of a plan at a time fits into memory."""
    return _tile_bytes(plan, points, area_m2) <= max_memory_bytes - PARENT_BYTES


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


def count_cells(options: Options, area_m2: float, faces: float) -> int:
    """Estimate the number of ground cells that engine borders unites at once; 0 for other engines.

    If faces are as large as cells, some cells stay empty: as many as with random placement.

    Parameters
    ----------
    options : Options
        Requested options of regions.
    area_m2 : float
        Area of the surface.
    faces : float
        Number of its faces.
    """
    if options.engine != "borders" or options.in_one_piece:
        return 0
    cell_m = border_segmenter(sized(options, math.sqrt(area_m2))).cell_m
    cells = area_m2 / cell_m**2
    return round(-cells * math.expm1(-faces / cells))


def cell_bytes(cells: int) -> int:
    """Forecast the peak memory of a build while cells are united to regions."""
    return PARENT_BYTES + CELL_BYTES * cells if cells else 0


def check_cells(cells: int, options: Options, max_memory_bytes: int) -> None:
    """Refuse a number of cells that takes more memory than allowed.

    Cells are united over the whole survey at once, whatever its tiles. Their number follows from
    the surface's area, so this is known before any tile is solved.

    Raises
    ------
    ResourceError
        States the memory or the region size that would suffice.
    """
    allowed = max(max_memory_bytes - PARENT_BYTES, int(_LEAST_CELL_SHARE * max_memory_bytes))
    if CELL_BYTES * cells <= allowed:
        return
    size_m = options.borders_size_m or BORDERS_SIZE_M
    # A quarter larger than their number requires: fewer of the larger cells are empty.
    fitting_m = 1.25 * size_m * math.sqrt(CELL_BYTES * cells / allowed)
    raise ResourceError(
        f"regions by engine borders: about {cells:,} cells of ground take "
        f"{cell_bytes(cells) / 2**30:.1f} GiB with the rest of the build; allowed are "
        f"{max_memory_bytes / 2**30:.1f} GiB: give --max-memory "
        f"{cell_bytes(cells) / 2**30 + 0.1:.1f}G, --region-size {math.ceil(fitting_m)}m, or "
        "--engine means"
    )
