"""Raster of the highest surface of a scene, and of the area hidden below it.

The raster is filled with triangles, tile by tile, in any order: each cell stores the height and
region of the highest surface at its centre. Hidden area is summed up by region, so that the plan
areas of regions (the areas of their triangles in plan, minus the hidden area) add up to the area of
the scene, however often the ground overhangs.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float32, Float64, Int8, Int32
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["MAX_CELLS", "TopSurface"]

MAX_CELLS: Final = 1 << 22
"""Maximum number of cells, 13 bytes each; larger scenes use wider cells."""


@dataclass(frozen=True, slots=True, eq=False)
class TopSurface:
    """A raster over x and z, filled by :meth:`add`."""

    low_m: tuple[float, float]
    """x and z of the corner of cell (0, 0)."""
    cell_m: float
    height_m: Float32
    """(nx, nz) y of the highest surface; NaN where there is none."""
    region: Int32
    """(nx, nz) its region; -1 where there is none."""
    column_m: Float32
    """(nx, nz) sum of the heights of surfaces that face up, minus those that face down."""
    net: Int8
    """(nx, nz) surfaces that face up, minus those that face down: 1 for ground without gaps."""
    hidden_m2: Float64
    """(R,) area of each region below other surfaces."""

    @classmethod
    def over(cls, low: AnyFloat, high: AnyFloat, regions: int, spacing_m: float) -> TopSurface:
        """Make an empty raster.

        Parameters
        ----------
        low, high : array-like of shape (3,)
            Bounding box of the scene.
        regions : int
            Number of regions.
        spacing_m : float
            Side of a cell, unless the raster would exceed :data:`MAX_CELLS`.
        """
        wide, deep = (max(float(high[axis] - low[axis]), 1e-6) for axis in (0, 2))
        # One cell more in each direction than the bounding box needs.
        cell_m = max(spacing_m, np.sqrt(wide * deep / MAX_CELLS), max(wide, deep) / MAX_CELLS)
        cell_m = float(cell_m)
        shape = int(wide / cell_m) + 2, int(deep / cell_m) + 2
        low_x, low_z = (np.floor(float(low[axis]) / cell_m) * cell_m for axis in (0, 2))
        return cls(
            (float(low_x), float(low_z)),
            cell_m,
            np.full(shape, np.nan, np.float32),
            np.full(shape, -1, np.int32),
            np.zeros(shape, np.float32),
            np.zeros(shape, np.int8),
            np.zeros(regions),
        )

    @property
    def empty_m(self) -> Float32:
        """(nx, nz) height of the empty space below overhangs.

        0 if the surfaces of a column are not the closed boundary of a solid.
        """
        empty: Float32 = np.where(
            self.net == 1, np.maximum(self.height_m - self.column_m, 0.0), 0.0
        )
        return empty

    def add(self, vertices: AnyFloat, faces: AnyInt, regions: AnyInt) -> None:
        """Add a part of the surface.

        Parameters
        ----------
        vertices : ndarray of shape (V, 3), float
            Scene frame.
        faces : ndarray of shape (F, 3), integer
        regions : ndarray of shape (F,), integer
        """
        _fill(
            as_kernel_input(vertices, np.float64),
            as_kernel_input(faces, np.int32),
            as_kernel_input(regions, np.int32),
            *self.low_m,
            self.cell_m,
            self.height_m,
            self.region,
            self.column_m,
            self.net,
            self.hidden_m2,
        )


@numba.njit(cache=True, nogil=True)
def _is_left(ax: float, az: float, bx: float, bz: float, px: float, pz: float) -> bool:
    """Return whether a point is left of an edge, consistently for both triangles at the edge.

    A point on the edge is assigned to one side, so that exactly one of the triangles has it.
    """
    if ax > bx or (ax == bx and az > bz):
        return not ((ax - bx) * (pz - bz) - (az - bz) * (px - bx) >= 0.0)
    return (bx - ax) * (pz - az) - (bz - az) * (px - ax) >= 0.0


@numba.njit(cache=True, nogil=True)
def _fill(
    vertices: Float64,
    faces: Int32,
    regions: Int32,
    low_x: float,
    low_z: float,
    cell_m: float,
    height: Float32,
    region: Int32,
    column: Float32,
    net: Int8,
    hidden: Float64,
) -> None:
    """Fill a raster in place."""
    nx, nz = height.shape
    cell_m2 = cell_m * cell_m
    for f in range(len(faces)):
        ax, ay, az = vertices[faces[f, 0]]
        bx, by, bz = vertices[faces[f, 1]]
        cx, cy, cz = vertices[faces[f, 2]]
        twice = (bx - ax) * (cz - az) - (bz - az) * (cx - ax)
        if twice == 0.0:
            continue
        first_i = max(int(np.ceil((min(ax, bx, cx) - low_x) / cell_m - 0.5)), 0)
        last_i = min(int(np.floor((max(ax, bx, cx) - low_x) / cell_m - 0.5)), nx - 1)
        first_j = max(int(np.ceil((min(az, bz, cz) - low_z) / cell_m - 0.5)), 0)
        last_j = min(int(np.floor((max(az, bz, cz) - low_z) / cell_m - 0.5)), nz - 1)
        is_left = twice > 0.0
        for i in range(first_i, last_i + 1):
            px = low_x + (i + 0.5) * cell_m
            for j in range(first_j, last_j + 1):
                pz = low_z + (j + 0.5) * cell_m
                if (
                    _is_left(ax, az, bx, bz, px, pz) != is_left
                    or _is_left(bx, bz, cx, cz, px, pz) != is_left
                    or _is_left(cx, cz, ax, az, px, pz) != is_left
                ):
                    continue
                u = ((bx - px) * (cz - pz) - (bz - pz) * (cx - px)) / twice
                v = ((cx - px) * (az - pz) - (cz - pz) * (ax - px)) / twice
                y = np.float32(u * ay + v * by + (1.0 - u - v) * cy)
                # Counter-clockwise seen from above is clockwise in x and z, as z points south.
                column[i, j] += -y if is_left else y
                net[i, j] += -1 if is_left else 1
                if region[i, j] < 0:
                    height[i, j], region[i, j] = y, regions[f]
                elif y > height[i, j]:
                    hidden[region[i, j]] += cell_m2
                    height[i, j], region[i, j] = y, regions[f]
                else:
                    hidden[regions[f]] += cell_m2
