"""Segmenting: regions over all tiles, segments within each, and which base they lie over.

Passes over the tiles, with what only the whole scene knows between them:

``segment-measure-00000``...  extents, densities, colours
``segment-scale``             what tiles are measured by; held by later surveys
``segment-units-00000``...    pieces of regions within the tile
``segment-regions``           those of all tiles united
``segment-numbers``           regions of the survey before that go on
``segment-samples``           what the next survey's regions are matched by
``segment-cut-00000``...      segments
``cover-scale``               what covers are measured by; held by later surveys
``segment-cover-00000``...    base faces under the segments
``segment``                   one numbering, one cover, one set of facts

The key of a tile's result names what the tile depends on and no number of anything far away, so a
survey over a scene computes the tiles that changed and takes the others up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from types import ModuleType

import numpy as np
import xxhash

from terraport_payload.types import AnyArray, Int32
from terraport_pipeline.geometry.regions.region_totals import slope_bins
from terraport_pipeline.geometry.volumes.toe_volumes import SurveyNoise
from terraport_pipeline.options import regions as segment
from terraport_pipeline.stages.contract import STORED, Context, Json, Stored
from terraport_pipeline.stages.tiles import (
    base_cover,
    numbered_regions,
    scene_facts,
    tiled_join,
    tiled_plan,
    tiled_segment,
)
from terraport_pipeline.stages.tiles.base_cover import CoverScale, NearBase
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles
from terraport_pipeline.stages.tiles.numbered_regions import NumberedRegions
from terraport_pipeline.stages.tiles.scene_facts import SceneScale, TiledScene
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
from terraport_pipeline.workflow.tile_memory import check_cells, count_cells

__all__ = ["Labels", "Segmented", "segment_tiles", "tile_numbers"]


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
        """Hash a tile's units together with their regions and pools, for the keys of later passes.

        Regions count by their numbers, which payloads hold; pools are numbered within the tile.
        """
        joined = self.regions.joined
        digest = xxhash.xxh3_128(np.ascontiguousarray(joined.region[tile]).data)
        digest.update(np.ascontiguousarray(joined.fine[tile]).data)
        return f"{self.units.records[tile].digest}-{digest.hexdigest()}"


@dataclass(frozen=True, slots=True)
class Segmented:
    """What segmenting leaves for textures and payloads."""

    scene: TiledScene
    labels: Labels
    numbers: Result[NumberedRegions]
    joined: Result[TiledSegmented]

    def cut_digest(self, tile: int) -> str:
        """Hash of the segment of every face of a tile."""
        assert self.labels.cuts is not None
        return str(self.labels.cuts.records[tile].values["segments_xxh3"])


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
    passes = _Passes(runner, tiles, options)
    # (1) What only the whole scene knows, from sums by tile; and what all tiles are measured by.
    measured = passes.measure()
    scene = tiled_segment.scene_of(measured.every())
    scale = passes.scale(scene, measured.digest)
    # (2) Units within every tile, united to regions over all tiles: in memory, as units are few.
    units = passes.units(scene, scale)
    joined_regions = passes.regions(units, scene, scale, measured.digest)
    # (3) Numbers, by those of the survey before.
    numbers = passes.numbers(units, joined_regions)
    joined = numbers.value().in_joined(joined_regions.value().joined)
    regions = Regions(joined, joined_regions.value().facts)
    labels = Labels(units, regions)
    # (4) Segments of every tile, and which base faces they lie over.
    cuts = passes.cut(labels, scale)
    labels = Labels(units, regions, cuts)
    tolerance_m = max(surface.deviation_m[2], segment.SMALLEST_TOLERANCE_M)
    cover_scale = passes.cover_scale(CoverScale.measure(base, tolerance_m), surface.base_digest)
    boxes = [tiles.box(tile) for tile in range(tiles.count)]
    near = NearBase.of(base, boxes, scene.median_edges_m, cover_scale.value())
    covers = passes.cover(labels, near, cover_scale)
    # (5) Plan areas and volumes of regions, over all tiles.
    count = joined.count
    noise_m = surface.noise_m
    survey = None if noise_m is None else SurveyNoise(surface.spacing_m, noise_m)
    plan = runner.run(
        Stage(
            tiled_plan.NAME,
            tiled_plan,
            lambda _: tiled_plan.run(scene, tiles, labels.region, count, surface.spacing_m, survey),
            STORED,
            {"spacing_m": surface.spacing_m, "noise_m": noise_m},
            {
                "tiles": tiles.digest,
                "labels": "-".join(labels.digest(tile) for tile in range(tiles.count)),
            },
        )
    )
    # (6) Join numbers, covers and facts of the tiles.
    result = runner.run(
        Stage(
            segment.NAME,
            tiled_join,
            lambda _: tiled_join.join(
                cuts.every(), covers.every(), scene, scale.value(), regions,
                _seam_regions(scene, labels), near, options, cover_scale.value().tolerance_m,
                plan.value().values,
            ),
            tiled_join.FORM,
            asdict(options),
            {
                "cuts": cuts.digest,
                "covers": covers.digest,
                "plan": plan.digest,
                "numbers": numbers.digest,
                "regions": joined_regions.digest,
                "measured": measured.digest,
                "scale": scale.digest,
                "base": surface.base_digest,
            },
        )
    )  # fmt: skip
    return Segmented(scene, labels, numbers, result)


@dataclass(frozen=True, slots=True, eq=False)
class _Passes:
    """Runs the passes of segmentation, each taken up where it is unchanged."""

    runner: Runner
    tiles: DetailTiles
    options: segment.Options

    def measure(self) -> TileResults:
        """Measure every tile."""
        return self._each(
            "segment-measure",
            tiled_segment,
            "segment: measure",
            lambda tile, context: tiled_segment.measure(self.tiles.load(tile), context),
            lambda _: {},
            tiled_segment.MEASURE_BYTES_PER_FACE,
        )

    def scale(self, scene: TiledScene, measured: str) -> Result[SceneScale]:
        """Decide what tiles are measured by."""
        extent_m, most = self.options.max_extent_m, self.options.max_faces
        return self.runner.run(
            Stage(
                "segment-scale",
                scene_facts,
                lambda _: SceneScale.decide(scene, extent_m, most),
                scene_facts.SCALE_FORM,
                {"max_extent_m": extent_m, "max_faces": most},
                {"measured": measured},
                is_decision=True,
                stands=lambda decided: decided.stands(scene),
            )
        )

    def units(self, scene: TiledScene, scale: Result[SceneScale]) -> TileResults:
        """Unite the faces of every tile up to the fine pools."""
        seams = [scene.seams.of(tile) for tile in range(self.tiles.count)]
        return self._each(
            "segment-units",
            tiled_segment,
            "segment: regions within tiles",
            lambda tile, context: tiled_segment.units(
                self.tiles.load(tile), seams[tile], scale.value(), self.options, context
            ),
            lambda tile: {"scale": scale.digest, "seams": _digest(*seams[tile])},
            tiled_segment.UNITS_BYTES_PER_FACE,
            asdict(self.options),
        )

    def regions(
        self, units: TileResults, scene: TiledScene, scale: Result[SceneScale], measured: str
    ) -> Result[Regions]:
        """Unite the units of all tiles; to engine borders the survey before is evidence."""
        before = self.runner.before
        stood = None
        if before is not None and self.options.engine == "borders":
            stood = before.find(numbered_regions.SAMPLES_NAME)

        def unite(context: Context) -> Regions:
            samples = before.work.load(stood) if before is not None and stood is not None else None
            tiles = units.every()
            if count_cells(self.options, 1.0, 1.0):  # engine borders: now an exact number
                cells = sum(len(tile.arrays["keys"]) for tile in tiles)
                check_cells(cells, self.options, self.runner.max_memory_bytes)
            return tiled_segment.regions(
                tiles, scene.seams, scale.value(), self.options, context, before=samples
            )

        return self.runner.run(
            Stage(
                "segment-regions",
                tiled_segment,
                unite,
                tiled_segment.REGIONS_FORM,
                asdict(self.options),
                {
                    "units": units.digest,
                    "measured": measured,
                    "scale": scale.digest,
                    **({} if stood is None else {"before": stood.digest}),
                },
            )
        )

    def numbers(self, units: TileResults, regions: Result[Regions]) -> Result[NumberedRegions]:
        """Give regions their numbers; remember what the next survey's are matched by."""
        runner, before = self.runner, self.runner.before
        names = (numbered_regions.NAME, numbered_regions.SAMPLES_NAME)
        records = [] if before is None else [before.find(name) for name in names]
        stood = [record for record in records if record is not None]

        def compute(context: Context) -> NumberedRegions:
            old = None
            if before is not None and len(stood) == len(names):
                old = before.work.load(stood[0]), before.work.load(stood[1])
            digests = [record.digest for record in units.records]
            joined = regions.value().joined
            return numbered_regions.number(
                self.tiles.names, digests, units.every(), joined, old, context
            )

        numbers = runner.run(
            Stage(
                numbered_regions.NAME,
                numbered_regions,
                compute,
                numbered_regions.NUMBERS_FORM,
                inputs={
                    "tiles": _digest(np.array(self.tiles.names)),
                    "units": units.digest,
                    "regions": regions.digest,
                    "before": "-".join(record.digest for record in stood),
                },
                is_remembered=True,
            )
        )
        samples: Result[Stored] = runner.run(
            Stage(
                numbered_regions.SAMPLES_NAME,
                numbered_regions,
                lambda _: numbered_regions.samples_of(units.every(), numbers.value()),
                STORED,
                inputs={"units": units.digest, "numbers": numbers.digest},
                is_remembered=True,
            )
        )
        samples.release()
        return numbers

    def cut(self, labels: Labels, scale: Result[SceneScale]) -> TileResults:
        """Cut every tile into segments."""
        joined = labels.regions.joined
        bins = slope_bins(joined.count)
        return self._each(
            "segment-cut",
            tiled_segment,
            "segment: segments",
            lambda tile, context: tiled_segment.cut(
                self.tiles.load(tile),
                labels.units.stored(tile),
                (joined.fine[tile], joined.region[tile]),
                scale.value(),
                self.options,
                context,
                bins=bins,
            ),
            lambda tile: {"scale": scale.digest, "labels": labels.digest(tile)},
            tiled_segment.CUT_BYTES_PER_FACE,
            {**asdict(self.options), "slope_bins": bins},
        )

    def cover_scale(self, measured: CoverScale, base: str) -> Result[CoverScale]:
        """Decide what the covers of all tiles are measured by."""
        return self.runner.run(
            Stage(
                "cover-scale",
                base_cover,
                lambda _: measured,
                base_cover.SCALE_FORM,
                inputs={"base": base, "tolerance": repr(measured.tolerance_m)},
                is_decision=True,
                stands=lambda decided: decided.stands(measured),
            )
        )

    def cover(self, labels: Labels, near: NearBase, scale: Result[CoverScale]) -> TileResults:
        """Find the base faces under the segments of every tile."""
        cuts = labels.cuts
        assert cuts is not None
        return self._each(
            "segment-cover",
            base_cover,
            "segment: cover",
            lambda tile, context: base_cover.cover(
                near.piece(tile),
                self.tiles.load(tile),
                labels.segment(tile),
                scale.value(),
                context,
            ),
            lambda tile: {
                "segments": str(cuts.records[tile].values["segments_xxh3"]),
                "base": near.digest(tile),
                "scale": scale.digest,
            },
            base_cover.COVER_BYTES_PER_FACE,
        )

    def _each(
        self,
        name: str,
        code: ModuleType,
        title: str,
        run: Callable[[int, Context], Stored],
        inputs: Callable[[int], Mapping[str, str]],
        bytes_per_face: int,
        options: Mapping[str, Json] | None = None,
    ) -> TileResults:
        """Run one pass; its inputs are each tile, and what is given."""
        numbers = range(self.tiles.count)
        return self.runner.run_tiles(
            TileStage(
                name,
                code,
                title,
                for_tiles(numbers, run),
                [{"tile": self.tiles.digest_of(tile), **inputs(tile)} for tile in numbers],
                [self.tiles.face_count(tile) for tile in numbers],
                options=options or {},
                bytes_per_unit=bytes_per_face,
                numbers=tile_numbers(self.tiles),
            )
        )


def tile_numbers(tiles: DetailTiles) -> list[int]:
    """Read the number of every tile in its name: tiles without detail are left out."""
    return [int(name.rpartition("-")[2]) for name in tiles.names]


def _digest(*arrays: AnyArray) -> str:
    digest = xxhash.xxh3_128()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).view(np.uint8).data)
    return digest.hexdigest()


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
