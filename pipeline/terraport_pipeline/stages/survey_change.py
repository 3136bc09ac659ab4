"""What the renew stage leaves of a change beside the survey's columns, and how it is read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload import gltf_attribute_name
from terraport_payload.types import AnyFloat, Float32, Float64
from terraport_pipeline.geometry.clouds.height_changes import HEIGHT_CHANGE, HeightChanges
from terraport_pipeline.geometry.regions.region_changes import ChangeMap
from terraport_pipeline.geometry.tiles.tile_plan import Lattice
from terraport_pipeline.stages.contract import Json

__all__ = [
    "SurveyChange",
    "TileHeights",
    "clashing_attribute",
    "load_change_map",
    "load_height_changes",
    "save_height_changes",
]

_DRAWN_IN: Final = 1e-3
"""Of a block's width, from the walls of a tile's box: far more than rounding to 32 bits moves a
vertex in a wall."""


@dataclass(frozen=True, slots=True, eq=False)
class TileHeights:
    """Height differences within the box of one tile.

    Nothing beyond it counts, not even for vertices in its walls: a tile in whose core no sample was
    renewed has the table that it had, though the ground beside it changed.
    """

    lattice: Lattice
    block_cells: int
    """Cells of the lattice along a block."""
    low: Float64
    """(3,) corner of the box, widths of a block; drawn in, so that walls lie within."""
    high: Float64
    heights: HeightChanges

    @classmethod
    def of(
        cls, heights: HeightChanges, lattice: Lattice, block_cells: int, box: Float64
    ) -> TileHeights:
        """Take what lies in a box, (6,) lowest and highest x, y, z."""
        low, high = lattice.cells(box.reshape(2, 3)) / block_cells
        low = low + _DRAWN_IN
        high = np.maximum(high - _DRAWN_IN, low)
        return cls(lattice, block_cells, low, high, heights.within(low, high))

    @property
    def digest(self) -> str | None:
        """What identifies them; None where no height is known to have changed."""
        return self.heights.digest() if len(self.heights.keys) else None

    def at(self, vertices: AnyFloat) -> Float32:
        """Interpolate at vertices (V, 3), scene frame; (V,) metres, NaN for none."""
        positions = self.lattice.cells(vertices) / self.block_cells
        return self.heights.at(np.clip(positions, self.low, self.high))


@dataclass(frozen=True, slots=True, eq=False)
class SurveyChange:
    """What the renew stage found, opened for the stages that tell of it."""

    lattice: Lattice
    block_cells: int
    heights: HeightChanges
    raster: ChangeMap
    digest: str
    """Of the renewed survey."""

    @classmethod
    def load(
        cls,
        folder: Path,
        values: Mapping[str, Json],
        lattice: Lattice,
        block_cells: int,
        digest: str,
    ) -> SurveyChange:
        """Read it from the folder and values of the renew stage's result."""
        heights = load_height_changes(folder)
        assert heights is not None  # every result of the stage has them
        return cls(lattice, block_cells, heights, load_change_map(folder, values), digest)

    def of_tile(self, box: Float64) -> TileHeights:
        """Take what lies in a box, (6,) lowest and highest x, y, z."""
        return TileHeights.of(self.heights, self.lattice, self.block_cells, box)


def clashing_attribute(attributes: Iterable[str]) -> str | None:
    """Name the survey's attribute in whose place the height differences would stand, if any."""
    taken = gltf_attribute_name(HEIGHT_CHANGE)
    return next((name for name in attributes if gltf_attribute_name(name) == taken), None)


def load_height_changes(folder: Path) -> HeightChanges | None:
    """Read the last change of all ground from a survey's columns; None where it is a first one."""
    path = folder / "heights-keys.npy"
    if not path.exists():
        return None
    keys, dz_m, per_block = (
        np.load(folder / f"heights-{name}.npy", allow_pickle=False)
        for name in ("keys", "dz", "per-block")
    )
    return HeightChanges(int(per_block[0]), keys, dz_m)


def save_height_changes(folder: Path, heights: HeightChanges) -> None:
    """Write what :func:`load_height_changes` reads."""
    np.save(folder / "heights-keys.npy", heights.keys)
    np.save(folder / "heights-dz.npy", heights.dz_m)
    np.save(folder / "heights-per-block.npy", np.array([heights.per_block]))


def load_change_map(folder: Path, values: Mapping[str, Json]) -> ChangeMap:
    """Read the raster that the renew stage left.

    Parameters
    ----------
    folder : Path
    values : mapping
        The result's values.

    Raises
    ------
    OSError, ValueError, KeyError, TypeError
        It is not there, or not what the stage writes.
    """
    raster = values["raster"]
    dz_m, lod_m, moved = (
        np.load(folder / f"change-{name}.npy", allow_pickle=False)
        for name in ("dz", "lod", "moved")
    )
    shape = tuple(raster["shape"])
    if not dz_m.shape == lod_m.shape == moved.shape == shape:
        raise ValueError(f"rasters of {dz_m.shape}, {lod_m.shape}, {moved.shape}; expected {shape}")
    low_x, low_z = (float(side) for side in raster["low_m"])
    return ChangeMap(
        (low_x, low_z),
        float(raster["cell_m"]),
        dz_m.astype(np.float32),
        lod_m.astype(np.float32),
        moved.astype(np.bool_),
        float(raster["registration_m"]),
    )
