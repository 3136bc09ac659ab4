"""The textures of a scene as values: what the stage makes and the payloads take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from terraport_payload import Texture
from terraport_payload.types import AnyInt, Float32, Int32, Int64, UInt8, UInt16

__all__ = ["TextureSet"]


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
