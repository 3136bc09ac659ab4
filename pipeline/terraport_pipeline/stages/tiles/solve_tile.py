"""One tile: from its samples to its piece of the detail.

Cleaned as the whole would be (what is usual is the whole survey's, not the tile's), reconstructed
in a cube of the common lattice, cut to the core, freed of what no sample supports at all, coloured
from its samples. What lies in the core's walls is described for the join. Memory: about 510 bytes
per sample of the data box, then the solver's, then about 250 bytes per face.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from terraport_payload.types import AnyArray, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.engines import poisson
from terraport_pipeline.geometry.clouds.carry import carry_values
from terraport_pipeline.geometry.clouds.footprint import Occupancy
from terraport_pipeline.geometry.clouds.normals import estimate_normals, orient_normals
from terraport_pipeline.geometry.clouds.outliers import duplicate_mask, outlier_mask
from terraport_pipeline.geometry.clouds.smooth import smooth_samples
from terraport_pipeline.geometry.clouds.spacing import (
    areal_from_radius,
    nearest_neighbours,
    remaining_neighbours,
)
from terraport_pipeline.geometry.clouds.support import BINS, support_histogram, support_ratio
from terraport_pipeline.geometry.mesh.trim import compact
from terraport_pipeline.geometry.tiles.tile_plan import REACH_CELLS
from terraport_pipeline.geometry.tiles.tile_weld import TileBorder
from terraport_pipeline.options.clean import MIN_POINTS
from terraport_pipeline.stages.contract import Context, Json, Stored

__all__ = ["TileTask", "border_of", "run", "sample_type"]

SNAP_CELLS: Final = 2e-3
"""Vertices this near to a wall lie in it: the solver computes in 32 bits."""

GREY: Final = 160

_NOISE_DEVIATIONS: Final = 4.0
"""A sample farther than this from the fit to its neighbours is a thing of its own, not noise."""


@dataclass(frozen=True, slots=True)
class TileTask:
    """What a tile needs to know; plain values."""

    depth: int
    """Depth of the tile's octree."""
    cell_m: float
    centre_cells: tuple[float, float, float]
    """Middle of the core, in cells of the lattice; whole numbers."""
    anchor_m: tuple[float, float, float]
    """Corner of the lattice, scene frame."""
    core_cells: int
    margin_cells: float
    origin: tuple[float, float, float]
    """Scene origin: easting, northing, height in the CRS."""
    spacing_m: float
    """Areal spacing of the whole survey."""
    usual: tuple[float, float]
    """:func:`terraport_pipeline.geometry.clouds.outliers.usual_distance` of the whole survey."""
    columns: tuple[str, ...]
    """Of the samples: ``a0``, ``a1``, ... are these."""
    attributes: tuple[str, ...]
    """Those of them that the surface gets."""
    codes: tuple[str, ...]
    has_colour: bool
    outlier_ratio: float
    outlier_deviations: float
    normal_neighbours: int
    point_weight: float
    kept_ratio: float
    """Surface farther than this many local spacings from a sample is dropped at once; the join
    decides on the rest, when it knows what both sides of a wall say."""
    raster_low: tuple[float, float]
    """x and z of the corner of cell (0, 0) of the scene's raster of samples;
    geometry/clouds/footprint.py."""
    raster_cell_m: float
    noise_m: float = 0.0
    """Of the whole survey's samples across their surface."""
    smoothing_m: float = 0.0
    """Radius of the fits that samples are moved onto before they are solved; 0 moves none."""

    @property
    def centre_m(self) -> Float64:
        """Middle of the core, scene frame, metres."""
        return np.array(self.anchor_m) + np.array(self.centre_cells) * self.cell_m


def sample_type(attributes: list[tuple[str, str]], *, has_colour: bool) -> np.dtype[Any]:
    """Row of a tile's samples on disk.

    Parameters
    ----------
    attributes : list of (name, dtype)
        The fields are called ``a0``, ``a1``, ...
    has_colour : bool
    """
    fields: list[Any] = [("position", "<f8", (3,))]
    if has_colour:
        fields.append(("colour", "u1", (3,)))
    fields += [(f"a{i}", code) for i, (_, code) in enumerate(attributes)]
    return np.dtype(fields)


def run(task: TileTask, samples: AnyArray, above: Float32, context: Context) -> Stored:
    """Reconstruct one tile.

    Parameters
    ----------
    task : TileTask
    samples : structured ndarray of shape (N,)
        :func:`sample_type`; positions in metres, CRS frame, in file order.
    above : ndarray of shape (R, 3), float32
        What lies above the data box, in cells from the low corner of the core;
        :meth:`terraport_pipeline.geometry.tiles.sky_raster.SkyRaster.above`.
    context : Context

    Returns
    -------
    Stored
        Arrays of the piece about the middle of the core (:attr:`TileTask.centre_m`), and of its
        border; no vertex at all where nothing of the surface lies in the core. Values hold the
        counts.

    Raises
    ------
    EngineError, ResourceError
        As :func:`terraport_pipeline.engines.poisson.reconstruct`.
    """
    # (1) Clean samples; those within reach of the core.
    counts: dict[str, Json] = {"samples": len(samples), "outliers": 0, "duplicates": 0, "core": 0}
    above_m = ((above - task.core_cells / 2) * task.cell_m).astype(np.float32)
    cloud = _clean(task, samples, above_m, counts, context)
    if cloud is None:
        return _nothing(task, counts)
    points, normals, local_m, rows = cloud
    half_m = 0.5 * task.core_cells * task.cell_m
    near = (np.abs(points) <= half_m + REACH_CELLS * task.cell_m).all(axis=1)
    counts["core"] = int((np.abs(points) <= half_m).all(axis=1).sum())
    if int(near.sum()) < 3:
        return _nothing(task, counts)
    # (2) What decides over all tiles: where samples lie and how densely, for the outline.
    raster, raster_spacing_m = _occupied(task, points, local_m)
    # (3) Solve, then cut along the core's walls: every tile solves its margin, none keeps it.
    vertices, faces = _solve(task, points, normals, context)
    counts["faces_solved"] = len(faces)
    del normals
    vertices, faces = _cut(task, vertices, faces)
    if not len(faces):
        return _nothing(task, counts)
    # (4) Trim by support, generously: the threshold of the whole survey is found later.
    tree = cKDTree(points, balanced_tree=False)
    ratio = support_ratio(vertices, tree, local_m, task.spacing_m, workers=context.threads)
    histogram = support_histogram(vertices, faces, ratio)
    keep = np.asarray((ratio[faces] <= task.kept_ratio).all(axis=1), dtype=np.bool_)
    used = np.zeros(len(vertices), dtype=bool)
    used[faces[keep].ravel()] = True
    vertices, faces = compact(vertices, faces, keep)
    ratio = ratio[used]
    if not len(faces):
        return _nothing(task, counts)
    # (5) Values, and the border: vertices on the core's walls, which the join matches with the
    # neighbours'.
    colours, attributes = _carry(task, tree, samples, rows, vertices, context)
    border = border_of(task, vertices, faces, ratio)
    counts |= {"faces": len(faces), "vertices": len(vertices)}
    arrays: dict[str, npt.NDArray[np.generic]] = {
        "vertices": vertices,
        "faces": faces,
        "colours": colours,
        "ratio": ratio,
        "histogram": histogram,
        "raster-cells": raster,
        "raster-spacing": raster_spacing_m,
        "border-rows": border.rows,
        "border-cells": border.cells,
        "border-ratio": border.ratio,
        "border-edges": border.edges,
        "border-walls": border.walls,
    }
    arrays |= {f"attribute-{i}": values for i, values in enumerate(attributes.values())}
    return Stored(arrays, counts)


def border_of(task: TileTask, vertices: Float32, faces: Int32, ratio: Float32) -> TileBorder:
    """Describe what lies in the core's walls.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres about the core's middle; those in a wall exactly in it (:func:`_snap`).
    faces : ndarray of shape (F, 3), int32
    ratio : ndarray of shape (V,), float32
    """
    half = task.core_cells / 2
    cells = vertices.astype(np.float64) / task.cell_m
    wall = np.zeros(len(vertices), dtype=np.uint8)
    for axis in range(3):
        for high in (0, 1):
            on = np.abs(cells[:, axis] - (half if high else -half)) < SNAP_CELLS
            wall[on] |= 1 << (2 * axis + high)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    common = wall[edges[:, 0]] & wall[edges[:, 1]]
    edges, common = edges[common > 0], common[common > 0]
    # Open ones only: those that no face of the tile has the other way round.
    key = edges[:, 0].astype(np.int64) * len(vertices) + edges[:, 1]
    back = edges[:, 1].astype(np.int64) * len(vertices) + edges[:, 0]
    is_open = ~np.isin(back, key)
    edges, common = edges[is_open], common[is_open]
    rows = np.unique(edges).astype(np.int32)
    border_cells = cells[rows]
    for axis in range(3):
        for high, side in ((0, -half), (1, half)):
            on = (wall[rows] >> (2 * axis + high)) & 1 == 1
            border_cells[on, axis] = side
    border_cells += np.array(task.centre_cells)
    # An edge in two walls at once (along the line where four cores meet) counts for both.
    listed, walls = [], []
    for code in range(6):
        on = (common >> code) & 1 == 1
        listed.append(np.searchsorted(rows, edges[on]).astype(np.int32))
        walls.append(np.full(int(on.sum()), code, dtype=np.uint8))
    return TileBorder(
        rows, border_cells, ratio[rows], np.concatenate(listed), np.concatenate(walls)
    )


def _clean(
    task: TileTask, samples: AnyArray, above_m: Float32, counts: dict[str, Json], context: Context
) -> tuple[Float32, Float32, Float32, Int64] | None:
    """Drop copies and outliers, estimate normals: (points, normals, local spacing, rows)."""
    # (1) Copies of a point have no normal of their own.
    stays = np.flatnonzero(~duplicate_mask(np.ascontiguousarray(samples["position"])))
    counts["duplicates"] = len(samples) - len(stays)
    if len(stays) < MIN_POINTS:
        return None
    # (2) About the core's middle: float32 holds a tile's coordinates, not a survey's.
    local = samples["position"][stays] - np.array(task.origin)
    east, north, up = local.T
    points64 = np.stack([east, up, -north], axis=1) - task.centre_m
    workers = context.threads
    k = task.normal_neighbours
    # (3) Outliers by the whole survey's spacing (`usual`), so that tiles agree in their margins.
    neighbours = nearest_neighbours(points64, k, workers=workers)
    removed = outlier_mask(
        neighbours,
        ratio=task.outlier_ratio,
        deviations=task.outlier_deviations,
        usual=task.usual,
    )
    counts["outliers"] = int(removed.sum())
    if removed.any():
        if len(stays) - int(removed.sum()) < MIN_POINTS:
            return None
        neighbours = remaining_neighbours(points64, neighbours, removed, workers=workers)
        stays, points64 = stays[~removed], points64[~removed]
    # (4) Normals, of noisy samples after they are moved onto their surface; their signs are decided
    # on the lattice of the whole survey for the same reason.
    points = points64.astype(np.float32)
    del points64, local
    if task.smoothing_m > 0:
        del neighbours
        points, normals = smooth_samples(
            points, radius_m=task.smoothing_m, most_m=_NOISE_DEVIATIONS * task.noise_m
        )
        neighbours = nearest_neighbours(points, k, workers=workers)
    else:
        normals, _ = estimate_normals(points, neighbours, k=k, threads=workers)
    grid_m = np.array(task.anchor_m) - task.centre_m
    normals, _, _ = orient_normals(
        points,
        normals,
        neighbours,
        spacing_m=task.spacing_m,
        grid_origin_m=(float(grid_m[0]), float(grid_m[2])),
        above=above_m,
    )
    local_m = areal_from_radius(neighbours.distances[:, -1], neighbours.indices.shape[1])
    return points, normals, local_m, stays


def _occupied(task: TileTask, points: Float32, local_m: Float32) -> tuple[Int32, Float32]:
    """Cells of the scene's raster that samples of the core lie in, (K, 2), and their spacing."""
    half_m = 0.5 * task.core_cells * task.cell_m
    own = ((points >= -half_m) & (points < half_m)).all(axis=1)
    # A window of the raster over the core, about the core's middle as the points are.
    centre = task.centre_m[[0, 2]]
    low = np.array(task.raster_low)
    corner = ((centre - half_m - low) // task.raster_cell_m).astype(np.int64)
    width = int(2 * half_m / task.raster_cell_m) + 3
    window_low = low + corner * task.raster_cell_m - centre
    occupancy = Occupancy(
        (float(window_low[0]), float(window_low[1])),
        task.raster_cell_m,
        task.spacing_m,
        np.zeros((width, width), dtype=np.float32),
    )
    occupancy.add(points[own], local_m[own])
    i, j = np.nonzero(occupancy.spacing_m)
    cells = np.stack([i, j], axis=1) + corner
    return cells.astype(np.int32), occupancy.spacing_m[i, j]


def _solve(
    task: TileTask, points: Float32, normals: Float32, context: Context
) -> tuple[Float32, Int32]:
    """Reconstruct in the tile's cube, which two points at corners of the data box fix."""
    half_m = (0.5 * task.core_cells + task.margin_cells) * task.cell_m
    inside = (np.abs(points) < half_m).all(axis=1)
    corners = np.array([[-half_m] * 3, [half_m] * 3], dtype=np.float32)
    upright = np.array([[0, 1, 0], [0, 1, 0]], dtype=np.float32)
    return poisson.reconstruct(
        np.concatenate([points[inside], corners]),
        np.concatenate([normals[inside], upright]),
        task.depth,
        context.scratch,
        max_memory_bytes=context.max_memory_bytes,
        point_weight=task.point_weight,
        tick=context.progress.advance,
    )


def _cut(task: TileTask, vertices: Float32, faces: Int32) -> tuple[Float32, Int32]:
    """Keep the faces whose cell lies in the core; put what lies in a wall exactly there."""
    half = task.core_cells / 2
    cells = vertices.astype(np.float64) / task.cell_m
    for side in (-half, half):
        cells[np.abs(cells - side) < SNAP_CELLS] = side
    middle = cells[faces].mean(axis=1)
    keep = ((middle >= -half) & (middle < half)).all(axis=1)
    return compact((cells * task.cell_m).astype(np.float32), faces, keep)


def _carry(
    task: TileTask,
    tree: cKDTree,
    samples: AnyArray,
    rows: Int64,
    vertices: Float32,
    context: Context,
) -> tuple[UInt8, dict[str, Float32]]:
    colours = np.full((len(rows), 3), GREY, dtype=np.uint8)
    if task.has_colour:
        colours = samples["colour"][rows]
    attributes = {}
    for name in task.attributes:
        values = samples[f"a{task.columns.index(name)}"][rows].astype(np.float32)
        values[~np.isfinite(values)] = np.nan
        attributes[name] = values
    return carry_values(
        tree, colours, attributes, vertices, codes=task.codes, workers=context.threads
    )


def _nothing(task: TileTask, counts: dict[str, Json]) -> Stored:
    """Make the result of a tile without surface."""
    arrays: dict[str, npt.NDArray[np.generic]] = {
        "vertices": np.zeros((0, 3), np.float32),
        "faces": np.zeros((0, 3), np.int32),
        "colours": np.zeros((0, 3), np.uint8),
        "ratio": np.zeros(0, np.float32),
        "histogram": np.zeros(BINS),
        "raster-cells": np.zeros((0, 2), np.int32),
        "raster-spacing": np.zeros(0, np.float32),
        "border-rows": np.zeros(0, np.int32),
        "border-cells": np.zeros((0, 3)),
        "border-ratio": np.zeros(0, np.float32),
        "border-edges": np.zeros((0, 2), np.int32),
        "border-walls": np.zeros(0, np.uint8),
    }
    arrays |= {f"attribute-{i}": np.zeros(0, np.float32) for i in range(len(task.attributes))}
    return Stored(arrays, counts | {"faces": 0, "vertices": 0, "faces_solved": 0})
