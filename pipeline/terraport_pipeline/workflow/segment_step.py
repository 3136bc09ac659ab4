"""Segmenting: regions over all tiles, segments within each, and which base they lie over.

Passes over the tiles, with what only the whole scene knows between them: ``segment-measure``,
``segment-units``, ``segment-regions`` (once), ``segment-cut``, ``segment`` (once).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
import xxhash

from terraport_payload.types import Int32
from terraport_pipeline.stages import segment
from terraport_pipeline.stages.tiles import tiled_join, tiled_segment
from terraport_pipeline.stages.tiles.scene_facts import TiledScene
from terraport_pipeline.stages.tiles.tiled_join import TiledSegmented
from terraport_pipeline.stages.tiles.tiled_segment import Regions
from terraport_pipeline.workflow.reconstruct_step import Surface
from terraport_pipeline.workflow.runner import (
    Result,
    Runner,
    Stage,
    TileResults,
    TileStage,
    for_tiles,
)

__all__ = ["Labels", "Segmented", "segment_tiles"]


@dataclass(frozen=True, slots=True)
class Labels:
    """Region and segment of the faces of every tile."""

    units: TileResults
    regions: Regions
    cuts: TileResults | None = None
    """None until the segments are cut."""

    def region(self, tile: int) -> Int32:
        """Look up the region of every face of a tile, (F,)."""
        regions: Int32 = self.regions.joined.region[tile][self.unit(tile)]
        return regions

    def unit(self, tile: int) -> Int32:
        """Read the unit of every face of a tile, (F,), numbered within the tile."""
        return self.units.array(tile, "labels")

    def segment(self, tile: int) -> Int32:
        """Read the segment of every face of a tile, (F,), numbered within the tile."""
        assert self.cuts is not None
        return self.cuts.array(tile, "segments")

    def digest(self, tile: int) -> str:
        """Hash a tile's units together with their regions, for the keys of later passes."""
        joined = self.regions.joined
        digest = xxhash.xxh3_128(np.ascontiguousarray(joined.region[tile]).data)
        digest.update(np.ascontiguousarray(joined.fine[tile]).data)
        return f"{self.units.records[tile].digest}-{digest.hexdigest()}"


@dataclass(frozen=True, slots=True)
class Segmented:
    """What segmenting leaves for textures and payloads."""

    scene: TiledScene
    labels: Labels
    joined: Result[TiledSegmented]

    def cut_digest(self, tile: int) -> str:
        """Hash of a tile's segments."""
        assert self.labels.cuts is not None
        return self.labels.cuts.records[tile].digest


def segment_tiles(runner: Runner, surface: Surface, options: segment.Options) -> Segmented:
    """Run all passes of segmentation; one report for them together.

    Raises
    ------
    OptionError
        More regions than can be told apart at run time; an attribute that cannot be compared.
    """
    with runner.reported_as(segment.NAME):
        return _segment(runner, surface, options)


def _segment(runner: Runner, surface: Surface, options: segment.Options) -> Segmented:
    tiles, base = surface.tiles, surface.base
    numbers = range(tiles.count)
    faces = [tiles.face_count(tile) for tile in numbers]
    asked = asdict(options)
    # (1) What only the whole scene knows (extents, densities, colours), from sums by tile.
    measured = runner.run_tiles(
        TileStage(
            "segment-measure",
            tiled_segment,
            "segment: measure",
            for_tiles(
                numbers, lambda tile, context: tiled_segment.measure(tiles.load(tile), context)
            ),
            [{"tile": tiles.digest_of(tile)} for tile in numbers],
            faces,
            bytes_per_unit=tiled_segment.MEASURE_BYTES_PER_FACE,
        )
    )
    scene = tiled_segment.scene_of(measured.every(), options)
    # (2) Units within every tile.
    units = runner.run_tiles(
        TileStage(
            "segment-units",
            tiled_segment,
            "segment: regions within tiles",
            for_tiles(
                numbers,
                lambda tile, context: tiled_segment.units(
                    tiles.load(tile), tile, scene, options, context
                ),
            ),
            [{"tile": tiles.digest_of(tile), "measured": measured.digest} for tile in numbers],
            faces,
            options=asked,
            bytes_per_unit=tiled_segment.UNITS_BYTES_PER_FACE,
        )
    )
    # (3) Regions over all tiles: in memory, as units are few.
    regions = runner.run(
        Stage(
            "segment-regions",
            tiled_segment,
            lambda context: tiled_segment.regions(units.every(), scene, options, context),
            tiled_segment.REGIONS_FORM,
            asked,
            {"units": units.digest, "measured": measured.digest},
        )
    ).value()
    labels = Labels(units, regions)
    # (4) Segments of every tile, and which base faces they lie over.
    tolerance_m = max(surface.deviation_m[2], segment.SMALLEST_TOLERANCE_M)
    cuts = runner.run_tiles(
        TileStage(
            "segment-cut",
            tiled_segment,
            "segment: segments and cover",
            for_tiles(
                numbers,
                lambda tile, context: tiled_segment.cut(
                    tiles.load(tile),
                    units.stored(tile),
                    (regions.joined.fine[tile], regions.joined.region[tile]),
                    base,
                    scene,
                    options,
                    context,
                    region_count=regions.joined.count,
                    tolerance_m=tolerance_m,
                ),
            ),
            [
                {
                    "tile": tiles.digest_of(tile),
                    "measured": measured.digest,
                    "labels": labels.digest(tile),
                    "base": surface.base_digest,
                }
                for tile in numbers
            ],
            faces,
            options={**asked, "regions": regions.joined.count},
            bytes_per_unit=tiled_segment.CUT_BYTES_PER_FACE,
        )
    )
    # (5) One numbering, one cover, one set of facts.
    joined = runner.run(
        Stage(
            segment.NAME,
            tiled_join,
            lambda _: tiled_join.join(
                cuts.every(), scene, regions, _seam_regions(scene, labels), base, options,
                tolerance_m,
            ),
            tiled_join.FORM,
            asked,
            {"cuts": cuts.digest, "units": units.digest, "measured": measured.digest},
        )
    )  # fmt: skip
    return Segmented(scene, Labels(units, regions, cuts), joined)


def _seam_regions(scene: TiledScene, labels: Labels) -> Int32:
    """Look up the regions on both sides of every seam, (N, 2)."""
    seams = scene.seams
    regions = np.zeros(seams.faces.shape, np.int32)
    for tile in np.unique(seams.tiles):
        of_faces = labels.region(int(tile))
        for side in (0, 1):
            rows = np.flatnonzero(seams.tiles[:, side] == tile)
            regions[rows, side] = of_faces[seams.faces[rows, side]]
    return regions
