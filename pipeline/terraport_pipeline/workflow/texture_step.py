"""The textures of a build: passes over tiles, and what is done once for the scene.

The stages: ``texture-base`` (exposures, the base's atlas), ``texture-views-00007``,
``texture-cells-00007``, ``texture-levels``, ``texture-tile-00007``; reported as one.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from operator import attrgetter
from types import ModuleType
from typing import Any, Final

import numpy as np
import xxhash

from terraport_payload.types import AnyArray, Float32
from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.engines.mesh_texels import MeshTexels
from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.errors import OptionError
from terraport_pipeline.model import Mesh
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.stages import texture
from terraport_pipeline.stages.contract import Context, Facts, Form, Stored
from terraport_pipeline.stages.texture_set import TextureSet
from terraport_pipeline.stages.texture_sums import PHOTO_SHARES, TextureTally
from terraport_pipeline.stages.tiles import base_atlas, tiled_texture, tiled_views
from terraport_pipeline.stages.tiles.tiled_texture import Levels
from terraport_pipeline.stages.tiles.tiled_views import TextureScale
from terraport_pipeline.workflow import photo_input
from terraport_pipeline.workflow.brought import Brought
from terraport_pipeline.workflow.photo_input import LocatedPhotos
from terraport_pipeline.workflow.reconstruct_step import Surface
from terraport_pipeline.workflow.runner import (
    Result,
    Runner,
    Stage,
    TileResults,
    TileStage,
    for_tiles,
)
from terraport_pipeline.workflow.segment_step import Segmented
from terraport_pipeline.workflow.texture_counts import choice_counts, step_counts
from terraport_store.manifest import TextureInfo

__all__ = [
    "BaseTexture",
    "TextureInput",
    "Textures",
    "texture_base_alone",
    "texture_input",
    "texture_tiles",
]


@dataclass(slots=True, eq=False)
class TextureInput:
    """Options and inputs of texturing, and how to open the photos when they are needed."""

    options: texture.Options
    recorded: Mapping[str, Any]
    """What identifies photos and cameras, for the keys."""
    open_photos: Callable[[], OpenPhotos] | None = None
    """None for textures without photos."""
    texels: Callable[[], MeshTexels] | None = None
    """Opens the images of a mesh that was textured elsewhere; None elsewhere."""
    _opened: OpenPhotos | None = field(default=None, init=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False)

    def opened(self) -> OpenPhotos:
        """Open the photos when they are first needed: a build that is taken up needs none."""
        assert self.open_photos is not None
        with self._lock:
            if self._opened is None:
                self._opened = self.open_photos()
            return self._opened


def texture_input(
    asked: Texturing, photos: LocatedPhotos | None, brought: Brought, max_memory_bytes: int
) -> TextureInput:
    """Choose the source of a build's textures.

    Parameters
    ----------
    asked : Texturing
    photos : LocatedPhotos or None
        From :func:`.photo_input.locate_photos`.
    brought : Brought
        The scene's frame, samples that the cameras must see, a mesh's own images.
    max_memory_bytes : int
    """
    keep_bytes = texture.photo_bytes(max_memory_bytes)
    if asked.options.source == "mesh":
        open_texels = brought.texels
        if open_texels is None:
            raise OptionError(
                "textures from the mesh, which has none; leave out --texture-from mesh"
            )
        return TextureInput(
            asked.options,
            {"images": brought.source.digest},
            texels=lambda: open_texels(keep_bytes),
        )
    if photos is None:
        return TextureInput(asked.options, {})
    return TextureInput(
        asked.options,
        {
            "camera_offset": asked.camera_offset,
            "crs": None if brought.crs is None else asdict(brought.crs),
            "photos": photos.photos_xxh3,
            "cameras": photos.cameras_xxh3,
            # What decides on the photos before the stages see them.
            "code": code_digest(photo_input.__name__),
        },
        lambda: photos.open(
            brought.samples,
            brought.sample_colours,
            brought.origin,
            brought.crs,
            max_bytes=keep_bytes,
        ),
    )


@dataclass(frozen=True, slots=True, eq=False)
class BaseTexture:
    """Texture of the base, and what the manifest says of all textures."""

    textures: TextureSet
    info: TextureInfo
    digest: str


@dataclass(frozen=True, slots=True, eq=False)
class Textures:
    """Textures of a scene, those of the detail on disk."""

    base: BaseTexture
    drawn: TileResults

    def tile(self, tile: int) -> TextureSet:
        """Open the textures of one tile's segments; images stay on disk."""
        return tiled_texture.tile_textures(self.drawn.stored(tile).arrays)

    def digest_of(self, tile: int) -> str:
        """Hash of one tile's textures."""
        return self.drawn.records[tile].digest


@dataclass(frozen=True, slots=True, eq=False)
class _Base:
    """Result of texturing the base: its atlas and the photos' exposures, once for the scene."""

    textures: TextureSet
    gains: Float32
    facts: Facts


_BASE_FORM: Final[Form[_Base]] = Form(
    store=lambda result: Stored({**_arrays(result.textures), "gains": result.gains}, {}),
    restore=lambda stored, facts: _Base(
        tiled_texture.tile_textures(stored.arrays),
        np.asarray(stored.arrays["gains"], np.float32),
        facts,
    ),
    facts=attrgetter("facts"),
)

_LEVELS_FORM: Final[Form[Levels]] = Form(
    store=lambda result: Stored({"keys": result.keys, "level": result.level}, {}),
    restore=lambda stored, _facts: Levels(
        np.asarray(stored.arrays["keys"], np.int64), np.asarray(stored.arrays["level"], np.float64)
    ),
    facts=lambda result: Facts({"cells": len(result.keys)}),
)


@dataclass(frozen=True, slots=True, eq=False)
class _Passes:
    """Runs the passes of texturing over all tiles, each taken up where it is unchanged."""

    runner: Runner
    surface: Surface
    segmented: Segmented
    asked: TextureInput
    scale: TextureScale

    def base(self, base: Mesh) -> Result[_Base]:
        """Solve the photos' exposures and make the base's atlas."""
        asked = self.asked

        def compute(context: Context) -> _Base:
            if asked.texels is not None:
                return self._base_of_texels(base, asked.texels(), context)
            opened = None if asked.open_photos is None else asked.opened()
            base_textures = texture.texture_base(base, opened, asked.options, context)
            warnings = () if opened is None else opened.warnings
            gains = (
                np.zeros((0, 0), np.float32) if base_textures.gains is None else base_textures.gains
            )
            counts = {f"base_{name}": value for name, value in base_textures.atlases.facts.items()}
            notes: dict[str, list[str]] = {}  # whose shares the tiles say
            if opened is not None:
                counts |= {"photos": len(opened.views), "photos_left_out": opened.left_out}
                notes[PHOTO_SHARES] = [view.name for view in opened.views]
            return _Base(base_textures.atlases.textures, gains, Facts(counts, warnings, notes))

        return self.runner.run(
            Stage(
                "texture-base",
                texture,
                compute,
                _BASE_FORM,
                {**asdict(asked.options), **asked.recorded},
                {"surface": self.surface.digest, "kept": self.segmented.joined.digest},
                also=(base_atlas,),
            )
        )

    def _base_of_texels(self, base: Mesh, texels: MeshTexels, context: Context) -> _Base:
        """Draw the base's atlas from the mesh's own images."""
        options, tiles = self.asked.options, self.surface.tiles
        atlas = base_atlas.run(
            base, tiles, texels.texel_m(tiles.load(0)),
            base_atlas.Options(options.base_side, options.quality, options.kind), context,
            texels.samples,
        )  # fmt: skip
        counts = {f"base_{name}": value for name, value in atlas.facts.counts.items()}
        return _Base(atlas.textures, np.zeros((0, 0), np.float32), Facts(counts))

    def views(self, gains: Float32) -> TileResults:
        """Choose the photo of every face, tile by tile, each with a band of its neighbours."""
        surface = self.surface
        return self._pass(
            "texture-views",
            tiled_views,
            "texture: photos of tiles",
            lambda tile, context: tiled_views.choose(
                surface.tiles,
                tile,
                surface.base,
                self.asked.opened(),
                gains,
                self.scale,
                self.segmented.labels.segment(tile),
                context,
            ),
            {"gains": _gains_digest(gains)},
            tiled_views.CHOOSE_BYTES_PER_FACE,
            cuts=True,
        )

    def levels(self, chosen: TileResults, gains: Float32) -> Result[Levels]:
        """Sum up the seams of every tile, then solve the corrections of the whole scene."""
        views = [stored.arrays for stored in chosen.every()]
        cells = self._pass(
            "texture-cells",
            tiled_texture,
            "texture: seams of tiles",
            lambda tile, context: tiled_texture.level(
                self.surface.tiles, tile, views, gains, self.scale, context
            ),
            {"views": chosen.digest, "gains": _gains_digest(gains)},
            tiled_texture.DRAW_BYTES_PER_FACE,
        )
        return self.runner.run(
            Stage(
                "texture-levels",
                tiled_texture,
                lambda _: tiled_texture.solve([stored.arrays for stored in cells.every()]),
                _LEVELS_FORM,
                inputs={"cells": cells.digest},
            )
        )

    def draw(
        self, chosen: TileResults | None, levels: Result[Levels] | None, gains: Float32
    ) -> TileResults:
        """Bake the atlases of every tile's segments."""
        asked, tiles, labels = self.asked, self.surface.tiles, self.segmented.labels
        views = [] if chosen is None else [stored.arrays for stored in chosen.every()]

        # (1) One tile: from a mesh's images, from vertex colours, or from photos with the
        # neighbouring tiles' views.
        texels = None if asked.texels is None else asked.texels()

        def draw_tile(tile: int, context: Context) -> Stored:
            if texels is not None:
                return tiled_texture.draw_texels(
                    tiles.load(tile), tile, labels.segment(tile), texels, asked.options, context
                )
            if levels is None:
                return tiled_texture.draw_plain(
                    tiles.load(tile), tile, labels.segment(tile), asked.options, context
                )
            return tiled_texture.draw(
                tiles, tile, labels.segment(tile), views, levels.value(), asked.opened(), gains,
                self.scale, asked.options, context,
            )  # fmt: skip

        # (2) The pass; photos, gains, levels and views of any tile change every tile.
        shared = {"gains": _gains_digest(gains)}
        if levels is not None and chosen is not None:
            levels.value()  # before several threads ask for it
            shared |= {"levels": levels.digest, "views": chosen.digest}
        return self._pass(
            "texture-tile",
            tiled_texture,
            "texture: atlases of tiles",
            draw_tile,
            shared,
            tiled_texture.DRAW_BYTES_PER_FACE,
            cuts=True,
            options=asdict(asked.options),
        )

    def _pass(
        self,
        name: str,
        code: ModuleType,
        title: str,
        run: Callable[[int, Context], Stored],
        shared: Mapping[str, str],
        bytes_per_face: int,
        *,
        cuts: bool = False,
        options: Mapping[str, Any] | None = None,
    ) -> TileResults:
        numbers = range(self.surface.tiles.count)
        photos = 0
        if self.asked.open_photos is not None or self.asked.texels is not None:
            photos = texture.photo_bytes(self.runner.max_memory_bytes)
        return self.runner.run_tiles(
            TileStage(
                name,
                code,
                title,
                for_tiles(numbers, run),
                [
                    {
                        # A tile is looked at with a band of its neighbours.
                        "tile": f"{self.surface.digest}-{tile}",
                        **shared,
                        **({"segments": self.segmented.cut_digest(tile)} if cuts else {}),
                    }
                    for tile in numbers
                ],
                self.segmented.scene.faces,
                options={
                    **(options or {}),
                    **self.asked.recorded,
                    **self.scale.recorded(),
                },
                bytes_per_unit=bytes_per_face,
                shared_bytes=photos,
            )
        )


def texture_tiles(
    runner: Runner, surface: Surface, segmented: Segmented, asked: TextureInput
) -> Textures:
    """Make the textures of a scene.

    Parameters
    ----------
    runner : Runner
        Gets one report.
    surface : Surface
    segmented : Segmented
    asked : TextureInput
    """
    with runner.reported_as(texture.NAME) as group:
        # (1) The base, which also finds the photos' gains.
        passes = _Passes(runner, surface, segmented, asked, TextureScale.of(segmented.scene))
        base = passes.base(texture.faces_only(surface.base, segmented.joined.value().base_kept))
        base_result = base.value()
        chosen: TileResults | None = None
        levels: Result[Levels] | None = None
        # (2) With photos: the best views of every face, and smooth corrections over the whole
        # surface.
        if asked.open_photos is not None:
            chosen = passes.views(base_result.gains)
            levels = passes.levels(chosen, base_result.gains)
        # (3) Atlases of every tile.
        drawn = passes.draw(chosen, levels, base_result.gains)
        # (4) Facts of all passes.
        drawn_tiles = drawn.every()
        tally = TextureTally.total(tile.arrays for tile in drawn_tiles)
        counts, info = _summary(drawn_tiles, tally, base_result, asked.options)
        notes = {}
        if chosen is not None:
            counts |= choice_counts(chosen.records)
            faces = segmented.scene.face_count
            counts["borrowed_share"] = round(counts["choice_faces_borrowed"] / faces, 4)
            notes[PHOTO_SHARES] = tally.photo_shares(base_result.facts.notes[PHOTO_SHARES])
        counts |= step_counts(drawn_tiles)
        warnings, choices = texture.worth_saying(counts) if chosen is not None else ((), ())
        group.facts = Facts(counts, (*base_result.facts.warnings, *warnings), notes, choices)
    return Textures(BaseTexture(base_result.textures, info, base.digest), drawn)


def texture_base_alone(
    runner: Runner, surface: Surface, segmented: Segmented, options: base_atlas.Options
) -> BaseTexture:
    """Draw the base's image from the detail's colours, where segments keep their vertex colours.

    Parameters
    ----------
    runner : Runner
    surface : Surface
    segmented : Segmented
    options : base_atlas.Options
    """
    base = texture.faces_only(surface.base, segmented.joined.value().base_kept)
    drawn = runner.run(
        Stage(
            base_atlas.NAME,
            base_atlas,
            lambda context: base_atlas.run(
                base, surface.tiles, surface.spacing_m, options, context
            ),
            base_atlas.FORM,
            {**asdict(options), "spacing_m": surface.spacing_m},
            {"surface": surface.digest, "kept": segmented.joined.digest},
        )
    )
    atlas = drawn.value()
    return BaseTexture(atlas.textures, atlas.info, drawn.digest)


def _summary(
    tiles: Sequence[Stored], tally: TextureTally, base_result: _Base, options: texture.Options
) -> tuple[dict[str, Any], TextureInfo]:
    sides = np.concatenate([np.array(tile.arrays["sides"], np.int64) for tile in tiles])
    texels = int((sides[:, 0] * sides[:, 1]).sum())
    image_bytes = sum(int(tile.arrays["offsets"][-1]) for tile in tiles)
    measured = tally.facts()
    charts = sum(int(tile.values["charts"]) for tile in tiles)
    counts: dict[str, Any] = {
        "images": len(sides),
        "image_bytes": image_bytes,
        "texels": texels,
        "longest_side": int(sides.max()),
        "charts": charts,
        "faces_per_chart": round(
            sum(int(tile.values["drawn"]) for tile in tiles) / max(charts, 1), 1
        ),
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
