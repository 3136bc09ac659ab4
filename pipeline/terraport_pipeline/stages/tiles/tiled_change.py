"""What a survey over a scene changed, tile by tile: heights at the vertices, volumes of regions.

Both are read from what the renew stage left beside the survey's columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload import gltf_attribute_name
from terraport_payload.types import AnyFloat, Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.clouds.height_changes import HEIGHT_CHANGE, HeightChanges
from terraport_pipeline.geometry.regions.region_changes import (
    ChangeMap,
    RegionVolumes,
    add_shares,
    region_volumes,
)
from terraport_pipeline.geometry.tiles.tile_plan import Lattice
from terraport_pipeline.stages.contract import Json, Stored
from terraport_pipeline.stages.partition import BLOCK_CELLS
from terraport_pipeline.stages.renew import load_height_changes
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles

__all__ = [
    "NAME",
    "SurveyChange",
    "TileHeights",
    "clashing_attribute",
    "load_change_map",
    "run",
    "with_volumes",
]

NAME: Final = "change-regions"

_DECIMALS: Final = 3
"""Of volumes and areas: litres."""


@dataclass(frozen=True, slots=True, eq=False)
class TileHeights:
    """Height differences near one tile."""

    lattice: Lattice
    heights: HeightChanges

    @property
    def digest(self) -> str | None:
        """What identifies them; None where no height is known to have changed."""
        return self.heights.digest() if len(self.heights.keys) else None

    def at(self, vertices: AnyFloat) -> Float32:
        """Interpolate at vertices (V, 3), scene frame; (V,) metres, NaN for none."""
        return self.heights.at(self.lattice.cells(vertices) / BLOCK_CELLS)


@dataclass(frozen=True, slots=True, eq=False)
class SurveyChange:
    """What the renew stage found, opened for the stages that tell of it."""

    lattice: Lattice
    heights: HeightChanges
    raster: ChangeMap
    digest: str
    """Of the renewed survey."""

    @classmethod
    def load(
        cls, folder: Path, values: Mapping[str, Json], lattice: Lattice, digest: str
    ) -> SurveyChange:
        """Read it from the folder and values of the renew stage's result."""
        heights = load_height_changes(folder)
        assert heights is not None  # every result of the stage has them
        return cls(lattice, heights, load_change_map(folder, values), digest)

    def of_tile(self, box: Float64) -> TileHeights:
        """Take what lies near a box, (6,) lowest and highest x, y, z."""
        low, high = self.lattice.cells(box.reshape(2, 3)) / BLOCK_CELLS
        return TileHeights(self.lattice, self.heights.within(low, high))


def clashing_attribute(attributes: Iterable[str]) -> str | None:
    """Name the survey's attribute in whose place the height differences would stand, if any."""
    taken = gltf_attribute_name(HEIGHT_CHANGE)
    return next((name for name in attributes if gltf_attribute_name(name) == taken), None)


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


def run(change: ChangeMap, tiles: DetailTiles, regions: Callable[[int], Int32]) -> Stored:
    """Share the volumes out over the regions of all tiles.

    Parameters
    ----------
    change : ChangeMap
    tiles : DetailTiles
        Those that lie over a change are read, one at a time.
    regions : callable
        Gives the region of every face of a tile, (F,).

    Returns
    -------
    Stored
        Values: ``whole``, ``beyond`` (no surface lies there) and ``regions``, by their numbers as
        text; each with the fields of :class:`.RegionVolumes`.
    """

    def shares() -> Iterator[tuple[Int64, Float64]]:
        for tile in range(tiles.count):
            box = tiles.box(tile)
            if change.touches(box[:3], box[3:]):
                mesh = tiles.load(tile)
                yield add_shares(mesh.vertices, mesh.faces, regions(tile), change)

    by_region, beyond, whole = region_volumes(change, shares())
    return Stored(
        {},
        {
            "whole": _rounded(whole),
            "beyond": _rounded(beyond),
            "regions": {str(region): _rounded(rows) for region, rows in by_region.items()},
        },
    )


def with_volumes(document: Mapping[str, Any], volumes: Mapping[str, Json]) -> dict[str, Any]:
    """Write volumes into the contents of regions.json, which are not modified."""
    by_region = volumes["regions"]
    return {
        "change": {"whole": volumes["whole"], "beyond": volumes["beyond"]},
        **{key: value for key, value in document.items() if key != "regions"},
        "regions": [
            {**row, "change": by_region[str(row["id"])]} if str(row["id"]) in by_region else row
            for row in document["regions"]
        ],
    }


def _rounded(volumes: RegionVolumes) -> dict[str, float]:
    return {name: round(value, _DECIMALS) for name, value in asdict(volumes).items()}
