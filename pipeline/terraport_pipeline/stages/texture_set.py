"""The textures of a scene as values: what the stage makes and the payloads take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from terraport_payload import Texture
from terraport_payload.types import AnyInt, Float32, Int32, Int64, UInt8, UInt16
from terraport_pipeline.stages.contract import Facts
from terraport_store.manifest import TextureInfo

__all__ = ["Source", "TextureSet", "Textured", "texture_info"]


Source = Literal["photos", "vertex"]


@dataclass(frozen=True, slots=True, eq=False)
class TextureSet:
    """Texture coordinates of a mesh, and the encoded atlas of each of its pieces."""

    wedges: UInt16
    """(F, 3, 2) every face's corners in its piece's image, half texels from the upper left."""
    images: UInt8
    """(N,) image files, one behind the other."""
    offsets: Int64
    """(S + 1,) where each begins."""
    sides: Int32
    """(S, 2) width and height, texels."""

    def texture(self, piece: int) -> Texture:
        """Look up the encoded image of one piece, with its size and media type."""
        return Texture.of(self.images[self.offsets[piece] : self.offsets[piece + 1]].tobytes())

    def uvs(self, faces: AnyInt | slice, piece: int) -> Float32:
        """Coordinates of the corners of some faces of one piece, (K, 3, 2) in 0..1, exact."""
        sides: Float32 = self.sides[piece].astype(np.float32)
        return self.wedges[faces].astype(np.float32) / (np.float32(2.0) * sides)


@dataclass(frozen=True, slots=True, eq=False)
class Textured:
    """Texture sets of detail and base, and the resolution that they reach."""

    detail: TextureSet
    """Atlases of the detail, one a segment."""
    base: TextureSet
    """One piece: the base faces that are kept."""
    source: Source
    texel_m: float
    """Median length of a texel over the detail's surface."""
    gsd_m: float | None
    """Median ground sampling distance of the photos there."""
    facts: Facts


def texture_info(textured: Textured) -> TextureInfo:
    """Say of the textures what the manifest says."""
    sides = textured.detail.sides.astype(np.int64)
    return TextureInfo(
        source=textured.source,
        media_types=(textured.base.texture(0).media_type,),  # of all: one format a build
        segments=len(sides),
        base_side=int(textured.base.sides.max()),
        max_side=int(sides.max()),
        image_bytes=int(textured.detail.offsets[-1]),
        texels=int((sides[:, 0] * sides[:, 1]).sum()),
        texel_m=textured.texel_m,
        gsd_m=textured.gsd_m,
    )
