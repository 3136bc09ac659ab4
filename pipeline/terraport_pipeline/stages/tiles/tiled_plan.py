"""Plan areas and volumes of all regions, from the tiles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from terraport_payload.types import Int32
from terraport_pipeline.geometry.regions.region_plan import measure_plan
from terraport_pipeline.geometry.volumes.toe_volumes import SurveyNoise
from terraport_pipeline.geometry.volumes.top_surface import TopSurface
from terraport_pipeline.stages.contract import Stored
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles
from terraport_pipeline.stages.tiles.scene_facts import TiledScene

__all__ = ["NAME", "loose_parts", "run"]

NAME: Final = "plan-regions"

_LEAST_SHARE: Final = 0.03
"""Share of a region's volume above its toe that may not be material, above which a warning is
given."""


def run(
    scene: TiledScene,
    tiles: DetailTiles,
    regions: Callable[[int], Int32],
    count: int,
    spacing_m: float,
    survey: SurveyNoise | None,
) -> Stored:
    """Measure the plan area and volumes of all regions.

    Parameters
    ----------
    scene : TiledScene
    tiles : DetailTiles
        Read one at a time.
    regions : callable
        Returns the region of every face of a tile, (F,).
    count : int
        Number of regions.
    spacing_m : float
        Spacing of the points, or of a mesh's vertices.
    survey : SurveyNoise or None

    Returns
    -------
    Stored
        Values of :func:`.measure_plan`.
    """
    top = TopSurface.over(scene.low, scene.high, count, spacing_m)
    for tile in range(tiles.count):
        mesh = tiles.load(tile)
        top.add(mesh.vertices, mesh.faces, regions(tile))
    return Stored({}, measure_plan(top, survey))


def loose_parts(volumes: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return warnings about volumes that may not be material."""
    texts = []
    for key, what in (
        (
            "objects_m3",
            "may be trees, machines or walls (flanks steeper than 45 degrees)",
        ),
        ("overhang_m3", "are empty space under overhangs"),
    ):
        rows = [
            row
            for row in volumes.values()
            if row["above_m3"] > row["below_m3"]
            and row[key] > max(_LEAST_SHARE * row["above_m3"], row.get("uncertainty_m3", 0.0) / 2)
        ]
        if rows:
            most = max(row[key] / row["above_m3"] for row in rows)
            whole = sum(row[key] for row in rows)
            count = "1 region" if len(rows) == 1 else f"{len(rows):,} regions"
            texts.append(
                f"{whole:,.0f} m3 of the volumes above the toe of {count} {what}, up to "
                f"{min(most, 1.0):.0%} of the volume of one. The report names them."
            )
    return texts
