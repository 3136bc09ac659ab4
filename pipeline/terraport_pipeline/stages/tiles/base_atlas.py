"""The base's atlas in a scene without textures: drawn from the detail's own colours.

A base has an eighth of the detail's faces at most, so colours at its vertices lose seven of eight:
beside a landing it looked melted. Its image has them all. Every texel takes the colour of the
detail next to its place on the base (:mod:`~terraport_pipeline.geometry.textures.cell_colours`),
and charts, packing and gutters are those of textures from photos. Segments keep vertex colours.
Figures: ``docs/decisions/base-mesh.md``.

Memory: one tile, about 250 bytes per texel of the surface, and the image.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float32, UInt8
from terraport_pipeline.geometry.textures.cell_colours import CellColours, ColourField
from terraport_pipeline.model import Mesh
from terraport_pipeline.options.base_texture import Options
from terraport_pipeline.stages import texture
from terraport_pipeline.stages.contract import Context, Facts, Form, Stored
from terraport_pipeline.stages.texture_set import TextureSet
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles
from terraport_pipeline.stages.tiles.tiled_texture import tile_textures
from terraport_store.manifest import TextureInfo

__all__ = [
    "FORM",
    "MAX_BASE_BYTES",
    "NAME",
    "BaseAtlas",
    "Options",
    "image_bytes",
    "run",
]

NAME: Final = "base_atlas"

MAX_BASE_BYTES: Final = 3_000_000
"""Of base mesh and image together: every client loads all of it before it shows anything."""

_BYTES_PER_FACE: Final = 9.5
"""Of a textured base mesh without attributes, at most (measured: 4.7 to 9.5)."""

_BYTES_PER_VALUE: Final = 1.0
"""Of an attribute, for each face (measured: 0.6 to 0.9)."""

_LEAST_IMAGE_BYTES: Final = 300_000
"""An image smaller than that is no use: a base of so many faces goes beyond its bytes instead."""

_TEXEL_SPACINGS: Final = 1.0
"""Length of a texel in spacings of the points, at least. A half took the mean difference of a
quarry of 60,000 points from 2.7 to 1.8 levels, for twice the image's bytes and memory."""

_FILL: Final = 0.55
"""Share of an image that shows surface, about: the rest are gutters and what charts leave free."""


@dataclass(frozen=True, slots=True, eq=False)
class BaseAtlas:
    """The base's image, and what the manifest says of it."""

    textures: TextureSet
    info: TextureInfo
    facts: Facts


def image_bytes(faces: int, attributes: int) -> int:
    """Bytes that are left for the image of a base of so many faces.

    Examples
    --------
    >>> image_bytes(200_000, 1), image_bytes(1_000_000, 0)
    (900000, 300000)
    """
    mesh = faces * (_BYTES_PER_FACE + _BYTES_PER_VALUE * attributes)
    return max(int(MAX_BASE_BYTES - mesh), _LEAST_IMAGE_BYTES)


Samples = Callable[[Mesh, float], Iterator[tuple[Float32, UInt8]]]
"""Places on a tile (N, 3) in metres, so many that texels of that length find some, and their
colours (N, 3), in blocks."""


def _at_vertices(mesh: Mesh, _texel_m: float) -> Iterator[tuple[Float32, UInt8]]:
    yield mesh.vertices, mesh.colours


def run(
    base: Mesh,
    tiles: DetailTiles,
    spacing_m: float,
    options: Options,
    context: Context,
    samples: Samples = _at_vertices,
) -> BaseAtlas:
    """Draw the base's image.

    Parameters
    ----------
    base : Mesh
        Faces that are published.
    tiles : DetailTiles
        With the survey's colours at their vertices.
    spacing_m : float
        Typical distance between the survey's points; no texel is smaller. 0: as fine as fits.
    options : Options
    context : Context
    samples : callable, optional
        Where the detail's colours are known; at its vertices by default.

    Returns
    -------
    BaseAtlas
    """
    # (1) What a texel will be wide, or the cubes would be finer than anybody sees.
    a, b, c = (base.vertices[base.faces[:, k]].astype(np.float64) for k in range(3))
    area_m2 = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    texel_m = max(_TEXEL_SPACINGS * spacing_m, math.sqrt(area_m2 / (_FILL * options.side**2)), 1e-6)
    # (2) The detail's colours, tile by tile.
    context.progress.start("base: colours of tiles", float(tiles.count), "tiles")
    cells: list[CellColours] = []
    for tile in range(tiles.count):
        found: list[CellColours] = []
        for places, colours in samples(tiles.load(tile), texel_m):
            found = [CellColours.joined([*found, CellColours.of(places, colours, texel_m)])]
        cells += found
        context.progress.advance(1.0)
    field = ColourField(CellColours.joined(cells), threads=context.threads)
    context.progress.done({})
    # (3) The image, as of a base with photos in which no photo sees anything.
    most = image_bytes(len(base.faces), len(base.attributes))
    atlases = texture.texture_mesh(
        base, np.zeros(len(base.faces), np.int32), (), None, None,
        texture.Options(
            source="vertex", texel_m=texel_m, kind=options.kind, quality=options.quality,
            base_side=options.side,
        ),
        max_side=options.side, path=context.scratch / "base.images",
        threads=context.threads, progress=context.progress, label="base: image",
        colour_at=field, max_bytes=most,
    )  # fmt: skip
    facts = atlases.facts
    info = TextureInfo(
        source="vertex",
        media_types=(atlases.textures.texture(0).media_type,),
        segments=0,
        base_side=int(atlases.textures.sides.max()),
        max_side=0,
        image_bytes=0,
        texels=0,
        texel_m=facts["texel_m"],
        gsd_m=None,
    )
    counts: dict[str, Any] = {
        name: facts[name]
        for name in ("longest_side", "image_bytes", "texel_m", "charts", "crowded_share")
    }
    return BaseAtlas(atlases.textures, info, Facts(counts))


def _store(result: BaseAtlas) -> Stored:
    arrays = {
        name: getattr(result.textures, name) for name in ("wedges", "images", "offsets", "sides")
    }
    return Stored(arrays, result.info.model_dump(mode="json"))


def _restore(stored: Stored, facts: Facts) -> BaseAtlas:
    return BaseAtlas(
        tile_textures(stored.arrays), TextureInfo.model_validate(dict(stored.values)), facts
    )


FORM: Final = Form(_store, _restore, attrgetter("facts"))
