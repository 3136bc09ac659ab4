"""The textures of a build by tiles: passes over tiles, and what is done once for the scene.

The steps: ``texture-base`` (exposures, the base's atlas), ``texture-views-0007``,
``texture-cells-0007``, ``texture-levels``, ``texture-tile-0007``; told as one stage.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import xxhash

from terraport_payload.types import AnyArray, Bool, Float32, Int32
from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages import texture
from terraport_pipeline.stages.contract import Context, Facts, Stored
from terraport_pipeline.stages.texture_set import TextureSet
from terraport_pipeline.stages.texture_sums import TextureTally
from terraport_pipeline.stages.tiles import tiled_texture, tiled_views
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles
from terraport_pipeline.stages.tiles.tiled_segment import TiledScene
from terraport_pipeline.stages.tiles.tiled_texture import Levels
from terraport_pipeline.stages.tiles.tiled_views import TextureScale
from terraport_pipeline.workflow.report import StageReport
from terraport_pipeline.workflow.stage_runner import StageRunner, Step, key_of
from terraport_pipeline.workflow.texture_counts import choice_counts, step_counts
from terraport_pipeline.workflow.tile_runner import PassResult, TilePass, run_pass
from terraport_pipeline.workflow.workdir import Cost, StageRecord, WorkDirectory, stage_key
from terraport_store.manifest import TextureInfo

__all__ = ["TiledTextures", "TiledTexturing", "texture_tiles"]


@dataclass(slots=True, eq=False)
class TiledTexturing:
    """Options and inputs of texturing in tiles, and how to open the photos when they are needed."""

    options: texture.Options
    inputs: Mapping[str, Any]
    """What identifies photos and cameras, for the keys."""
    open_photos: Callable[[], OpenPhotos] | None = None
    """None for textures from vertex colours."""
    _opened: OpenPhotos | None = field(default=None, init=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False)

    def opened(self) -> OpenPhotos:
        """Open the photos when they are first needed: a build that is taken up needs none."""
        assert self.open_photos is not None
        with self._lock:
            if self._opened is None:
                self._opened = self.open_photos()
            return self._opened


@dataclass(frozen=True, slots=True, eq=False)
class TiledTextures:
    """Textures of a scene in tiles, those of the detail on disk."""

    base: TextureSet
    info: TextureInfo
    records: tuple[StageRecord, ...]
    """Records of the drawn tiles, in their order."""
    work: WorkDirectory
    digest: str
    """Hash of the exposures and the base's texture."""

    def tile(self, tile: int) -> TextureSet:
        """Open the textures of one tile's segments; images stay on disk."""
        return tiled_texture.tile_textures(self.work.mapped(self.records[tile]).arrays)


@dataclass(frozen=True, slots=True, eq=False)
class _Base:
    """Result of texturing the base: its atlas and the photos' exposures, once for the scene."""

    textures: TextureSet
    gains: Float32
    facts: Facts


class _Passes:
    """Runs the passes of texturing over all tiles, each taken up where it is unchanged."""

    def __init__(
        self,
        runner: StageRunner,
        tiles: DetailTiles,
        digest: str,
        scene: TiledScene,
        asked: TiledTexturing,
    ) -> None:
        self._runner, self._tiles, self._digest = runner, tiles, digest
        self._scene, self._asked = scene, asked
        self._scale = TextureScale.of(scene)

    def base(self, base: Mesh, digest: str) -> Step[_Base]:
        """Solve the photos' exposures and make the base's atlas; kept as one step."""
        asked = self._asked

        def compute(context: Context) -> _Base:
            opened = None if asked.open_photos is None else asked.opened()
            base_textures = texture.texture_base(base, opened, asked.options, context)
            warnings = () if opened is None else opened.warnings
            gains = (
                np.zeros((0, 0), np.float32) if base_textures.gains is None else base_textures.gains
            )
            counts = {f"base_{name}": value for name, value in base_textures.atlases.facts.items()}
            if opened is not None:
                counts |= {"photos": len(opened.views), "photos_left_out": opened.left_out}
            return _Base(base_textures.atlases.textures, gains, Facts(counts, warnings))

        return self._runner.step(
            "texture-base",
            stage_key(
                "texture-base",
                code_digest(texture.__name__),
                {**asdict(asked.options), **asked.inputs},
                {"tiles": self._digest, "base": digest},
            ),
            compute,
            lambda result: result.facts,
            lambda result: Stored({**_arrays(result.textures), "gains": result.gains}, {}),
            lambda stored, facts: _Base(
                tiled_texture.tile_textures(stored.arrays),
                np.asarray(stored.arrays["gains"], np.float32),
                facts,
            ),
        )

    def views(self, base: Mesh, gains: Float32) -> PassResult:
        """Choose the photo of every face, tile by tile, each with a band of its neighbours."""
        return run_pass(
            self._runner,
            self._pass(
                "texture-views",
                tiled_views.__name__,
                "texture: photos of tiles",
                tiled_views.CHOOSE_BYTES_PER_FACE,
                {"gains": _gains_digest(gains)},
            ),
            lambda tile, context: tiled_views.choose(
                self._tiles, tile, base, self._asked.opened(), gains, self._scale, context
            ),
        )

    def levels(self, chosen: PassResult, gains: Float32) -> tuple[PassResult, Step[Levels]]:
        """Sum up the seams of every tile, then solve the corrections of the whole scene."""
        views = self._arrays(chosen)
        cells = run_pass(
            self._runner,
            self._pass(
                "texture-cells",
                tiled_texture.__name__,
                "texture: seams of tiles",
                tiled_texture.DRAW_BYTES_PER_FACE,
                {"views": _digest(chosen), "gains": _gains_digest(gains)},
            ),
            lambda tile, context: tiled_texture.level(
                self._tiles, tile, views, gains, self._scale, context
            ),
        )
        step = self._runner.step(
            "texture-levels",
            key_of("tiled_texture", {}, {"cells": _digest(cells)}),
            lambda _: tiled_texture.solve(
                [self._runner.work.looked_up(record).arrays for record in cells.records]
            ),
            lambda result: Facts({"cells": len(result.keys)}),
            lambda result: Stored({"keys": result.keys, "level": result.level}, {}),
            lambda stored, _: Levels(
                np.asarray(stored.arrays["keys"], np.int64),
                np.asarray(stored.arrays["level"], np.float64),
            ),
        )
        return cells, step

    def draw(
        self,
        segments: Callable[[int], Int32],
        cuts: Sequence[StageRecord],
        chosen: PassResult | None,
        levels: Step[Levels] | None,
        gains: Float32,
    ) -> PassResult:
        """Bake the atlases of every tile's segments."""
        asked, tiles = self._asked, self._tiles
        views = (
            []
            if chosen is None
            else [self._runner.work.looked_up(record).arrays for record in chosen.records]
        )

        # (1) One tile: from vertex colours, or from photos with the neighbouring tiles' views.
        def one(tile: int, context: Context) -> Stored:
            if levels is None:
                return tiled_texture.draw_plain(
                    tiles.load(tile), tile, segments(tile), asked.options, context
                )
            return tiled_texture.draw(
                tiles, tile, segments(tile), views, levels.value(), asked.opened(), gains,
                self._scale, asked.options, context,
            )  # fmt: skip

        if levels is not None:
            levels.value()  # before several threads ask for it
        # (2) The pass; photos, gains, levels and views of any tile change every tile.
        shared = {"gains": _gains_digest(gains)}
        if levels is not None and chosen is not None:
            shared |= {"levels": levels.record.digest, "views": _digest(chosen)}
        return run_pass(
            self._runner,
            self._pass(
                "texture-tile",
                tiled_texture.__name__,
                "texture: atlases of tiles",
                tiled_texture.DRAW_BYTES_PER_FACE,
                shared,
                [record.digest for record in cuts],
                asdict(asked.options),
            ),
            one,
        )

    def _arrays(self, result: PassResult) -> list[Mapping[str, AnyArray]]:
        """Map the arrays that a pass stored of every tile."""
        return [self._runner.work.looked_up(record).arrays for record in result.records]

    def _pass(
        self,
        name: str,
        module: str,
        title: str,
        bytes_per_face: int,
        shared: Mapping[str, str],
        cuts: Sequence[str] | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> TilePass:
        inputs = [
            {
                "tile": f"{self._digest}-{tile}",
                **shared,
                **({} if cuts is None else {"segments": cuts[tile]}),
            }
            for tile in range(self._tiles.count)
        ]
        photos = 0
        if self._asked.open_photos is not None:
            photos = texture.photo_bytes(self._runner.max_memory_bytes)
        return TilePass(
            name,
            module,
            title,
            {**(options or {}), **self._asked.inputs, **self._scale.recorded()},
            inputs,
            self._scene.faces,
            bytes_per_face,
            photos,
        )


def texture_tiles(
    runner: StageRunner,
    tiles: DetailTiles,
    digest: str,
    scene: TiledScene,
    base: Mesh,
    base_kept: Bool,
    segments: Callable[[int], Int32],
    cuts: Sequence[StageRecord],
    asked: TiledTexturing,
) -> TiledTextures:
    """Make the textures of a scene in tiles.

    Parameters
    ----------
    runner : StageRunner
        Gets one report.
    tiles : DetailTiles
    digest : str
        Of base and tiles.
    scene : TiledScene
    base : Mesh
    base_kept : ndarray of shape (B,), bool
        Base faces that are published.
    segments : callable
        Gives the segment of every face of a tile, numbered within the tile.
    cuts : sequence of StageRecord
        Where the segments of every tile are kept.
    asked : TiledTexturing

    Returns
    -------
    TiledTextures
    """
    # (1) The base, which also finds the photos' gains.
    work = _Passes(runner, tiles, digest, scene, asked)
    kept = texture.faces_only(base, base_kept)
    before = len(runner.reports)
    first = work.base(kept, xxhash.xxh3_128_hexdigest(np.packbits(base_kept).data))
    base_result = first.value()
    chosen: PassResult | None = None
    levels: Step[Levels] | None = None
    passes: list[PassResult] = []
    # (2) With photos: the best views of every face, and smooth corrections over the whole
    # surface.
    if asked.open_photos is not None:
        chosen = work.views(base, base_result.gains)
        cells, levels = work.levels(chosen, base_result.gains)
        passes = [chosen, cells]
    # (3) Atlases of every tile.
    passes.append(drawn := work.draw(segments, cuts, chosen, levels, base_result.gains))
    # (4) Facts and cost of all passes, as one stage.
    drawn_tiles = [runner.work.looked_up(record) for record in drawn.records]
    counts, info = _summary(drawn_tiles, base_result, asked.options)
    if chosen is not None:
        counts |= choice_counts(chosen.records)
        counts["borrowed_share"] = round(counts["choice_faces_borrowed"] / sum(scene.faces), 4)
    counts |= step_counts(drawn_tiles)
    warnings = (*base_result.facts.warnings, *texture.worth_warning(counts)) if chosen else ()
    alone, runner.reports[before:] = runner.reports[before:], []
    costs = [*(report.cost for report in alone), *(result.cost for result in passes)]
    runner.reports.append(
        StageReport(
            texture.NAME,
            all(report.taken_up for report in alone) and all(one.taken_up for one in passes),
            Cost(sum(cost.seconds for cost in costs), max(cost.peak_bytes for cost in costs)),
            Facts(counts, warnings),
        )
    )
    return TiledTextures(
        base_result.textures, info, drawn.records, runner.work, first.record.digest
    )


def _summary(
    tiles: Sequence[Stored], base_result: _Base, options: texture.Options
) -> tuple[dict[str, Any], TextureInfo]:
    sides = np.concatenate([np.array(tile.arrays["sides"], np.int64) for tile in tiles])
    texels = int((sides[:, 0] * sides[:, 1]).sum())
    image_bytes = sum(int(tile.arrays["offsets"][-1]) for tile in tiles)
    measured = TextureTally.total(tile.arrays for tile in tiles).facts()
    counts: dict[str, Any] = {
        "images": len(sides),
        "image_bytes": image_bytes,
        "texels": texels,
        "longest_side": int(sides.max()),
        "charts": sum(int(tile.values["charts"]) for tile in tiles),
        "cells_share": round(sum(float(tile.values["used"]) for tile in tiles) / texels, 3),
        **measured,
        **base_result.facts.counts,
    }
    info = TextureInfo(
        source=options.source,
        media_types=(base_result.textures.texture(0).media_type,),
        segments=len(sides),
        base_side=int(base_result.textures.sides.max()),
        max_side=int(sides.max()),
        image_bytes=image_bytes,
        texels=texels,
        texel_m=measured["texel_m"],
        gsd_m=measured["gsd_m"],
    )
    return counts, info


def _arrays(textures: TextureSet) -> dict[str, AnyArray]:
    return {name: getattr(textures, name) for name in ("wedges", "images", "offsets", "sides")}


def _gains_digest(gains: Float32) -> str:
    return xxhash.xxh3_128_hexdigest(np.ascontiguousarray(gains).data)


def _digest(result: PassResult) -> str:
    return xxhash.xxh3_128_hexdigest("".join(record.digest for record in result.records).encode())
