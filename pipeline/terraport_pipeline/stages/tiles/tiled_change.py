"""Volumes of cut and fill of every region, tile by tile."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from typing import Any, Final

from terraport_payload.types import Float64, Int32, Int64
from terraport_pipeline.geometry.regions.region_changes import (
    ChangeMap,
    RegionVolumes,
    add_shares,
    region_volumes,
)
from terraport_pipeline.stages.contract import Json, Stored
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles

__all__ = ["NAME", "run", "with_volumes"]

NAME: Final = "change-regions"

_DECIMALS: Final = 3
"""Of volumes and areas: litres."""


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
