"""The last stages of every build: payloads of every tile, then one scene of them all, published."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float32, Float64, Int32
from terraport_pipeline.stages import pack
from terraport_pipeline.stages.contract import STORED, Form, Stored
from terraport_pipeline.stages.region_ids import CarriedNumbers
from terraport_pipeline.stages.survey_change import SurveyChange, TileHeights, clashing_attribute
from terraport_pipeline.stages.tiles import tiled_change, tiled_pack
from terraport_pipeline.workflow.reconstruct_step import Surface
from terraport_pipeline.workflow.report import StageReport
from terraport_pipeline.workflow.runner import Result, Runner, Stage, TileStage, for_tiles
from terraport_pipeline.workflow.segment_step import Labels, Segmented, tile_numbers
from terraport_pipeline.workflow.texture_step import BaseTexture, Textures
from terraport_store.errors import StoreError
from terraport_store.layout import MANIFEST_NAME
from terraport_store.manifest import BuildInfo, CrsInfo, InputInfo, Manifest

__all__ = ["build_info", "publish_tiles"]


def publish_tiles(
    runner: Runner,
    scene: Path,
    surface: Surface,
    segmented: Segmented,
    textures: Textures | None,
    base_texture: BaseTexture | None,
    about: pack.About,
    options: pack.Options,
    change: SurveyChange | None = None,
    *,
    prepare: Callable[[], None] = lambda: None,
    into: Path | None = None,
) -> tuple[str, bool]:
    """Encode every tile's payloads and publish them, unless the scene already is that version.

    Parameters
    ----------
    runner : Runner
        Gets one report.
    scene : Path
        Scene directory.
    surface : Surface
    segmented : Segmented
    textures : Textures or None
        None where payloads keep their vertex colours.
    base_texture : BaseTexture or None
        None where the base keeps its vertex colours.
    about : pack.About
        What the manifest says beyond the meshes.
    options : pack.Options
    change : SurveyChange, optional
        What the survey changed, over a scene that was there.
    prepare : callable
        Called right before the scene is published, unless it is already.
    into : Path, optional
        Where to publish instead, over what stands in `scene`.

    Returns
    -------
    version : str
    published : bool
        False when the scene already was this version.
    """
    with runner.reported_as(pack.NAME):
        joined, labels, tiles = segmented.joined.value(), segmented.labels, surface.tiles
        extents = tiled_pack.Extents.of(segmented.scene, joined, surface.base, surface.spacing_m)
        scales = runner.run(
            Stage(
                tiled_pack.SCALES_NAME,
                tiled_pack,
                lambda _: tiled_pack.scales_of(extents),
                tiled_pack.SCALES_FORM,
                inputs={"extents": json.dumps(extents.recorded(), sort_keys=True)},
                is_decision=True,
                stands=lambda decided: decided.stands(extents),
            )
        ).value()
        heights = _heights_of(surface, change)
        # (1) Payloads of every tile. Its inputs name all that a payload holds, so a tile whose
        # surface, labels, cut, textures and height differences are unchanged is not encoded again.
        payloads = runner.run_tiles(
            TileStage(
                "pack-tile",
                tiled_pack,
                "pack: tiles",
                for_tiles(
                    range(tiles.count),
                    lambda tile, context: tiled_pack.encode(
                        tiles.load(tile),
                        labels.segment(tile),
                        labels.region(tile),
                        scales,
                        context,
                        None if textures is None else textures.tile(tile),
                        heights[tile],
                        options.levels,
                    ),
                ),
                [
                    {
                        "tile": tiles.digest_of(tile),
                        "labels": labels.digest(tile),
                        "cut": segmented.cut_digest(tile),
                        **({} if textures is None else {"textures": textures.digest_of(tile)}),
                        **_digest_of(heights[tile]),
                    }
                    for tile in range(tiles.count)
                ],
                segmented.scene.faces,
                options={**scales.recorded(), "levels": options.levels},
                bytes_per_unit=tiled_pack.ENCODE_BYTES_PER_FACE,
                numbers=tile_numbers(tiles),
            )
        )
        # (2) Volumes of cut and fill by region.
        volumes = None
        if change is not None:
            volumes = _volumes(runner, surface, labels, change)
            facts = tiled_change.with_volumes(joined.region_facts, volumes.value().values)
            joined = replace(joined, region_facts=facts)
        # (3) One scene of them all, published in one act.
        numbers = segmented.numbers
        carried = None
        if runner.before is not None:
            carried = CarriedNumbers(runner.before.version, numbers.value().before)
        pieces = _Pieces(surface, labels, segmented.scene.face_count, about.origin, about.crs)
        stage = Stage(
            pack.NAME,
            tiled_pack,
            lambda context: tiled_pack.publish(
                scene, surface.base, joined, payloads.stored, pieces, scales, extents.ranges,
                surface.deviation_m, about, options, context,
                None if base_texture is None else (base_texture.textures, base_texture.info),
                carried,
                into=into,
            ),
            _PUBLISHED,
            {
                **asdict(options),
                "build": about.build.model_dump(mode="json"),
                "crs": None if about.crs is None else about.crs.model_dump(mode="json"),
            },
            {
                "payloads": payloads.digest,
                "segments": segmented.joined.digest,
                "numbers": numbers.digest,
                "base": surface.base_digest,
                **({} if base_texture is None else {"base_texture": base_texture.digest}),
                **({} if volumes is None else {"volumes": volumes.digest}),
            },
        )  # fmt: skip
        record = runner.take_up(stage.name, stage.key)
        if record is not None and not _is_published(into or scene, record.values):
            runner.work.forget(stage.name)  # packed once, and gone or replaced since
            record = None
        if record is None:
            prepare()
        published = runner.run(stage)
        return str(published.record.values["version"]), not runner.reports[-1].taken_up


def _heights_of(surface: Surface, change: SurveyChange | None) -> list[TileHeights | None]:
    """Take the height differences near every tile; None where there are none to be written."""
    tiles = surface.tiles
    if change is None or clashing_attribute(tiles.attributes) is not None:
        return [None] * tiles.count
    near = [change.of_tile(tiles.box(tile)) for tile in range(tiles.count)]
    return [None if heights.digest is None else heights for heights in near]


def _digest_of(heights: TileHeights | None) -> dict[str, str]:
    """Give the key's entry; none where a tile is as it would be of a first survey."""
    digest = None if heights is None else heights.digest
    return {} if digest is None else {"heights": digest}


def _volumes(
    runner: Runner, surface: Surface, labels: Labels, change: SurveyChange
) -> Result[Stored]:
    """Share the volumes of cut and fill out over the regions."""
    return runner.run(
        Stage(
            tiled_change.NAME,
            tiled_change,
            lambda _: tiled_change.run(change.raster, surface.tiles, labels.region),
            STORED,
            inputs={
                "change": change.digest,
                "tiles": surface.tiles.digest,
                "labels": "-".join(labels.digest(tile) for tile in range(surface.tiles.count)),
            },
        )
    )


_PUBLISHED: Final[Form[pack.Packed]] = Form(
    store=lambda packed: Stored({}, {"version": packed.manifest.version}),
    restore=lambda _stored, _facts: _not_loaded(),
    facts=lambda packed: packed.facts,
)


def _not_loaded() -> pack.Packed:
    raise AssertionError("a published scene is opened by its readers")


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """The new surface, segment by segment, read tile by tile."""

    surface: Surface
    labels: Labels
    face_count: int
    origin: Float64
    crs: CrsInfo | None

    def pieces(self) -> Iterator[tuple[Float32, Int32, Int32]]:
        """Give every segment's vertices, faces and regions."""
        for tile in range(self.surface.tiles.count):
            mesh, regions = self.surface.tiles.load(tile), self.labels.region(tile)
            segments = self.labels.segment(tile)
            order = np.argsort(segments, kind="stable")
            starts = np.searchsorted(segments[order], np.arange(int(segments.max()) + 2))
            for begin, end in itertools.pairwise(starts):
                chosen = order[begin:end]
                yield mesh.vertices, mesh.faces[chosen], regions[chosen]


def build_info(
    recorded: Mapping[str, Any], input_info: InputInfo, reports: Sequence[StageReport]
) -> BuildInfo:
    """Say in the manifest how a scene came about.

    Parameters
    ----------
    recorded : mapping
        Options that change the published bytes.
    input_info : InputInfo
    reports : sequence of StageReport
        Of all stages but this one.
    """
    try:
        release = version("terraport")
    except PackageNotFoundError:
        release = "unknown"
    return BuildInfo(
        terraport=release,
        options=dict(recorded),
        input=input_info,
        warnings=tuple(text for report in reports for text in report.facts.warnings),
        choices=tuple(text for report in reports for text in report.facts.choices),
        stages=tuple({"name": r.name, "counts": r.facts.counts} for r in reports),
    )


def _is_published(scene: Path, values: Mapping[str, Any]) -> bool:
    """Whether the scene is the version that was packed, with all its files in full size."""
    try:
        manifest = Manifest.from_bytes((scene / MANIFEST_NAME).read_bytes())
        return manifest.version == values["version"] and all(
            (scene / file.path).stat().st_size == file.bytes for file in manifest.files.values()
        )
    except (OSError, StoreError):
        return False
