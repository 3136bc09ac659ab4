"""The build of a survey larger than memory: tiles from reading to packing.

The same stages as :mod:`terraport_pipeline.workflow.build`, each over tiles; what one tile takes is
bounded, what grows with the scene is small. Every tile's result is kept, so an interrupted build
goes on with the tile it was at. What differs from the whole: ``docs/topics/tiled-build.md``.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import xxhash

from terraport_payload.types import Float32, Float64, Int32
from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.geometry.tiles.tiled_means import JoinedRegions
from terraport_pipeline.measure import Measure
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages import pack, segment
from terraport_pipeline.stages.texture_set import TextureSet
from terraport_pipeline.stages.tiles import base_atlas, tiled_join, tiled_pack, tiled_segment
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles
from terraport_pipeline.workflow.base_atlas_step import base_atlas_step
from terraport_pipeline.workflow.publish_step import pack_once
from terraport_pipeline.workflow.report import StageReport
from terraport_pipeline.workflow.stage_runner import StageRunner
from terraport_pipeline.workflow.tile_runner import PassResult, TilePass, run_pass
from terraport_pipeline.workflow.tiled_textures import (
    TiledTextures,
    TiledTexturing,
    texture_tiles,
)
from terraport_pipeline.workflow.workdir import Cost, WorkDirectory, stage_key
from terraport_store.manifest import CrsInfo, TextureInfo

__all__ = ["TiledSurface", "check_tiled", "segment_and_pack"]

_SEGMENT_MODULE: Final = tiled_segment.__name__


@dataclass(frozen=True, slots=True, eq=False)
class TiledSurface:
    """Two levels of one surface, the detail in tiles."""

    base: Mesh
    tiles: DetailTiles
    deviation_m: tuple[float, ...]
    """50th, 95th, 99th and 99.9th percentile of the distance of detail to base."""
    digest: str
    """Hash of base and tiles; in the keys of all passes."""
    spacing_m: float = 0.0
    """Typical distance between the points; see :class:`pack.About`."""


def check_tiled(options: segment.Options) -> None:
    """Refuse what cannot be segmented tile by tile, before any work.

    Raises
    ------
    OptionError
    """
    tiled_segment.check_options(options)


def segment_and_pack(
    runner: StageRunner,
    scene: Path,
    surface: TiledSurface,
    options: segment.Options,
    pack_options: pack.Options,
    about: Callable[[], pack.About],
    texturing: TiledTexturing | None = None,
    base_image: base_atlas.Options | None = None,
) -> tuple[str, bool]:
    """Do everything after reconstruction.

    Parameters
    ----------
    runner : StageRunner
        Gets one report per stage.
    scene : Path
        Scene directory.
    surface : TiledSurface
    options : segment.Options
    pack_options : pack.Options
    about : callable
        Makes what the manifest says beyond the meshes, when all stages but the last have reported.
    texturing : TiledTexturing, optional
        Textures instead of vertex colours.
    base_image : base_atlas.Options, optional
        Without textures: an image for the base, drawn from the detail's colours.

    Returns
    -------
    version : str
    published : bool
        False when the scene already was this version.

    Raises
    ------
    OptionError
        What cannot be done by tiles.
    """
    # (1) Regions, segments and cover; the scales that all payloads share.
    check_tiled(options)
    scene_facts, segmented, labels, cuts = _Work(runner, surface, options).segmented()
    scales = tiled_pack.scales_of(scene_facts, segmented, surface.base, surface.spacing_m)
    textures: TiledTextures | None = None
    base_texture: tuple[str, TextureSet, TextureInfo] | None = None
    # (2) Textures of every tile, where they are asked for; else of the base alone.
    if texturing is not None:
        textures = texture_tiles(
            runner,
            surface.tiles,
            surface.digest,
            scene_facts,
            surface.base,
            segmented.base_kept,
            lambda tile: runner.work.array(cuts.records[tile], "segments"),
            cuts.records,
            texturing,
        )
        base_texture = textures.digest, textures.base, textures.info
    elif base_image is not None:
        drawn = base_atlas_step(
            runner,
            surface.base,
            segmented.base_kept,
            surface.tiles,
            surface.digest,
            surface.spacing_m,
            base_image,
        )
        atlas = drawn.value()
        base_texture = drawn.record.digest, atlas.textures, atlas.info
    described = about()
    # (3) Payloads of every tile. Its inputs name all that a payload holds, so a tile whose
    # surface, labels, cut and textures are unchanged is not encoded again.
    encoded = TilePass(
        "pack-tile",
        tiled_pack.__name__,
        "pack: tiles",
        scales.recorded(),
        [
            {
                "tile": f"{surface.digest}-{i}",
                "labels": labels.digest(i),
                "cut": record.digest,
                **({} if textures is None else {"textures": textures.records[i].digest}),
            }
            for i, record in enumerate(cuts.records)
        ],
        scene_facts.faces,
        tiled_pack.ENCODE_BYTES_PER_FACE,
    )
    payloads = run_pass(
        runner,
        encoded,
        lambda tile, context: tiled_pack.encode(
            surface.tiles.load(tile),
            runner.work.array(cuts.records[tile], "segments"),
            labels.of(tile),
            scales,
            context,
            None if textures is None else textures.tile(tile),
        ),
    )
    # (4) One scene of them all, published in one act.
    key = stage_key(
        pack.NAME,
        code_digest(tiled_pack.__name__),
        {
            **asdict(pack_options),
            "build": described.build.model_dump(mode="json"),
            "crs": None if described.crs is None else described.crs.model_dump(mode="json"),
        },
        {
            "payloads": _digest(payloads),
            "segments": _segments_digest(segmented),
            **({} if base_texture is None else {"base_texture": base_texture[0]}),
        },
    )
    version, published = pack_once(
        runner,
        scene,
        key,
        lambda context: tiled_pack.publish(
            scene,
            surface.base,
            segmented,
            lambda tile: runner.work.mapped(payloads.records[tile]),
            _Pieces(
                surface,
                runner.work,
                labels,
                cuts,
                scene_facts.face_count,
                described.origin,
                described.crs,
            ),
            scales,
            surface.deviation_m,
            described,
            pack_options,
            context,
            None if base_texture is None else base_texture[1:],
        ),
    )
    if published:  # to the reader, encoding and publishing are one stage
        last = runner.reports.pop()
        cost = _together(last.cost, payloads.cost)
        runner.reports.append(StageReport(last.name, last.taken_up, cost, last.facts))
    return version, published


def _together(*costs: Cost) -> Cost:
    """Add up the cost of passes that ran one after another: seconds add, peaks do not."""
    return Cost(sum(cost.seconds for cost in costs), max(cost.peak_bytes for cost in costs))


def _segments_digest(segmented: tiled_join.TiledSegmented) -> str:
    """Hash the joined segmentation: what the manifest and the index will say of segments."""
    stored = tiled_join.store(segmented)
    digest = xxhash.xxh3_128(json.dumps(dict(stored.values), sort_keys=True).encode())
    for name in sorted(stored.arrays):
        digest.update(np.ascontiguousarray(stored.arrays[name]).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


@dataclass(slots=True)
class _Labels:
    """Regions of the faces of every tile, from their units."""

    work: WorkDirectory
    units: PassResult
    joined: JoinedRegions

    def of(self, tile: int) -> Int32:
        """Read the units of a tile's faces and look up the region of each, (F,)."""
        regions: Int32 = self.joined.region[tile][self.unit(tile)]
        return regions

    def unit(self, tile: int) -> Int32:
        """Read the unit of every face of a tile, (F,), numbered within the tile."""
        return self.work.array(self.units.records[tile], "labels")

    def digest(self, tile: int) -> str:
        """Hash a tile's units together with their regions, for the keys of later passes."""
        digest = xxhash.xxh3_128(np.ascontiguousarray(self.joined.region[tile]).data)
        digest.update(np.ascontiguousarray(self.joined.fine[tile]).data)
        return f"{self.units.records[tile].digest}-{digest.hexdigest()}"


class _Work:
    """Runs the passes of segmentation over all tiles, each taken up where it is unchanged."""

    def __init__(
        self, runner: StageRunner, surface: TiledSurface, options: segment.Options
    ) -> None:
        self._runner, self._surface, self._options = runner, surface, options
        self._faces = [surface.tiles.face_count(i) for i in range(surface.tiles.count)]

    def segmented(
        self,
    ) -> tuple[tiled_segment.TiledScene, tiled_join.TiledSegmented, _Labels, PassResult]:
        """Run all passes of segmentation and add one report for them together."""
        runner, surface, options = self._runner, self._surface, self._options
        work, tiles, base = runner.work, surface.tiles, surface.base
        # (1) What only the whole scene knows (extents, densities, colours), from sums by tile.
        measured = run_pass(
            runner,
            self._pass(
                "segment-measure", "segment: measure", {}, tiled_segment.MEASURE_BYTES_PER_FACE
            ),
            lambda tile, context: tiled_segment.measure(tiles.load(tile), context),
        )
        scene_facts = tiled_segment.scene_of(
            [work.looked_up(record) for record in measured.records]
        )
        shared = {"measured": _digest(measured)}
        # (2) Units within every tile.
        united = run_pass(
            runner,
            self._pass(
                "segment-units",
                "segment: regions within tiles",
                asdict(options),
                tiled_segment.UNITS_BYTES_PER_FACE,
                shared,
            ),
            lambda tile, context: tiled_segment.units(
                tiles.load(tile), tile, scene_facts, options, context
            ),
        )
        # (3) Regions over all tiles: in memory, as units are few.
        progress = runner.progress
        with Measure() as joining, work.scratch() as scratch:
            progress.start("segment: regions across tiles", None, "units")
            joined = tiled_segment.regions(
                [work.looked_up(record) for record in united.records],
                scene_facts,
                options,
                runner.context(scratch),
            )
            progress.done({"regions": joined.count})
        labels = _Labels(work, united, joined)
        # (4) Segments of every tile, and which base faces they lie over.
        tolerance_m = max(surface.deviation_m[2], segment.SMALLEST_TOLERANCE_M)
        cuts = run_pass(
            runner,
            self._pass(
                "segment-cut",
                "segment: segments and cover",
                {**asdict(options), "regions": joined.count},
                tiled_segment.CUT_BYTES_PER_FACE,
                shared,
                labels,
            ),
            lambda tile, context: tiled_segment.cut(
                tiles.load(tile),
                labels.unit(tile),
                (joined.fine[tile], joined.region[tile]),
                base,
                scene_facts,
                options,
                context,
                region_count=joined.count,
                tolerance_m=tolerance_m,
            ),
        )
        # (5) One numbering, one cover, one set of facts; reported as one stage together with the
        # passes.
        passes = (measured, united, cuts)
        step = runner.step(
            tiled_join.NAME,
            stage_key(
                tiled_join.NAME,
                code_digest(tiled_join.__name__),
                asdict(options),
                {"cuts": _digest(cuts), "units": _digest(united)},
            ),
            lambda _: tiled_join.join(
                (work.mapped(record) for record in cuts.records),
                scene_facts,
                joined,
                self._seam_regions(scene_facts, labels),
                base,
                options,
                tolerance_m,
            ),
            lambda result: result.facts,
            tiled_join.store,
            tiled_join.restore,
        )
        last = runner.reports.pop()
        joined_cost = Cost(joining.seconds, joining.peak_bytes)
        cost = _together(last.cost, joined_cost, *(tile_pass.cost for tile_pass in passes))
        taken_up = last.taken_up and all(tile_pass.taken_up for tile_pass in passes)
        runner.reports.append(StageReport(last.name, taken_up, cost, last.facts))
        return scene_facts, step.value(), labels, cuts

    def _pass(
        self,
        name: str,
        title: str,
        options: dict[str, Any],
        bytes_per_face: int,
        shared: dict[str, str] | None = None,
        labels: _Labels | None = None,
    ) -> TilePass:
        digest = self._surface.digest
        inputs = [
            {
                "tile": f"{digest}-{tile}",
                **(shared or {}),
                **({} if labels is None else {"labels": labels.digest(tile)}),
            }
            for tile in range(len(self._faces))
        ]
        return TilePass(name, _SEGMENT_MODULE, title, options, inputs, self._faces, bytes_per_face)

    @staticmethod
    def _seam_regions(scene_facts: tiled_segment.TiledScene, labels: _Labels) -> Int32:
        seams = scene_facts.seams
        regions = np.zeros(seams.faces.shape, np.int32)
        for tile in np.unique(seams.tiles):
            of_faces = labels.of(int(tile))
            for side in (0, 1):
                rows = np.flatnonzero(seams.tiles[:, side] == tile)
                regions[rows, side] = of_faces[seams.faces[rows, side]]
        return regions


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """The new surface, segment by segment, read tile by tile."""

    surface: TiledSurface
    work: WorkDirectory
    labels: _Labels
    cuts: PassResult
    face_count: int
    origin: Float64
    crs: CrsInfo | None

    def pieces(self) -> Iterator[tuple[Float32, Int32, Int32]]:
        """Give every segment's vertices, faces and regions."""
        for tile, record in enumerate(self.cuts.records):
            mesh, regions = self.surface.tiles.load(tile), self.labels.of(tile)
            segments = self.work.array(record, "segments")
            order = np.argsort(segments, kind="stable")
            starts = np.searchsorted(segments[order], np.arange(int(segments.max()) + 2))
            for begin, end in itertools.pairwise(starts):
                chosen = order[begin:end]
                yield mesh.vertices, mesh.faces[chosen], regions[chosen]


def _digest(result: PassResult) -> str:
    return xxhash.xxh3_128_hexdigest("".join(record.digest for record in result.records).encode())
