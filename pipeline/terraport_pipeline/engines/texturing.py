"""Textures in pictures: the colour of a hit, from the image of its face.

Each image is read at the halving that fits its distance (a mip level): a picture of the whole scene
needs no texel of the finest level, so textures of any number cost little memory. Within a level
colours are bilinear.
"""

from __future__ import annotations

import io
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
import PIL.Image

from terraport_payload.types import AnyFloat, Float32, Float64, Int32, UInt8
from terraport_pipeline.engines.rays import Hits
from terraport_pipeline.errors import EngineError

__all__ = [
    "ImageCache",
    "TextureImages",
    "Texturing",
    "bilinear",
    "decode_halved",
    "rgb_of",
    "textured_colours",
]

MAX_HALVINGS: Final = 3
"""JPEG decoders halve up to three times while they decode, for a fraction of the time."""

CACHE_BYTES: Final = 256 << 20
"""Decoded images kept: 20 of 2048 x 2048 at full size, 1,300 at the eighth."""


class TextureImages(Protocol):
    """Source of decoded texture images by number; they may be decoded only when asked for."""

    def size(self, image: int) -> tuple[int, int]:
        """Return the width and height of an image at full size."""
        ...

    def get(self, image: int, halvings: int) -> UInt8:
        """Return an image, (H, W, 3) sRGB, both sides halved so often."""
        ...


class ImageCache:
    """Images decoded when wanted; the longest unused go first. Safe in several threads.

    Parameters
    ----------
    read : callable
        Image number -> the file's bytes; called in one thread at a time.
    sizes : mapping of int to (int, int)
        Width and height of each.
    max_bytes : int
        Bound on what is kept; one image may exceed it while it is in use.
    """

    def __init__(
        self,
        read: Callable[[int], bytes],
        sizes: Mapping[int, tuple[int, int]],
        max_bytes: int = CACHE_BYTES,
    ) -> None:
        self._read, self._sizes, self._max_bytes = read, sizes, max_bytes
        self._kept: OrderedDict[tuple[int, int], UInt8] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    def size(self, image: int) -> tuple[int, int]:
        """Return the width and height of an image at full size."""
        return self._sizes[image]

    def get(self, image: int, halvings: int) -> UInt8:
        """Return an image; see :class:`TextureImages`.

        Raises
        ------
        EngineError
            When it does not decode.
        """
        key = (image, halvings)
        # Held while decoding: two threads that want the same image must not both decode it.
        with self._lock:
            cached = self._kept.get(key)
            if cached is not None:
                self._kept.move_to_end(key)
                return cached
            pixels = decode_halved(self._read(image), halvings)
            self._kept[key] = pixels
            self._bytes += pixels.nbytes
            while self._bytes > self._max_bytes and len(self._kept) > 1:
                self._bytes -= self._kept.popitem(last=False)[1].nbytes
            return pixels


@dataclass(frozen=True, slots=True, eq=False)
class Texturing:
    """Texture coordinates of a mesh's corners, and the image that each face reads."""

    uvs: Float32
    """(V, 2) 0..1 from the image's upper left."""
    image_of_face: Int32
    """(F,) number of the image; -1 where vertex colours hold."""
    images: TextureImages


def decode_halved(data: bytes, halvings: int) -> UInt8:
    """Decode an image file with both sides halved so often.

    Parameters
    ----------
    data : bytes
        What Pillow reads: JPEG, PNG, WebP.
    halvings : int
        0 to :data:`MAX_HALVINGS`.

    Returns
    -------
    ndarray of shape (H, W, 3), uint8
        sRGB; sides are rounded up.

    Raises
    ------
    EngineError
        When it does not decode.
    """
    try:
        with PIL.Image.open(io.BytesIO(data)) as opened:
            width, height = opened.size
            wanted = (max(1, -(-width // 2**halvings)), max(1, -(-height // 2**halvings)))
            opened.draft("RGB", wanted)  # JPEG only; elsewhere it does nothing
            image = rgb_of(opened)
        factor = max(1, round(image.width / wanted[0]))
        return np.asarray(image.reduce(factor) if factor > 1 else image)
    except (OSError, SyntaxError, ValueError) as error:
        raise EngineError(f"an image of {len(data)} bytes does not decode: {error}") from error


def rgb_of(image: PIL.Image.Image) -> PIL.Image.Image:
    """Convert an image to 8 bits of red, green and blue; alpha is dropped.

    Pillow's own conversion clips 16-bit grey at 255, so that nearly all pixels become white.

    Raises
    ------
    ValueError
        The pixels are 32-bit numbers without a defined white.
    """
    if image.mode.startswith("I;16") or (image.mode == "I" and image.format == "PNG"):
        levels = (np.asarray(image).astype(np.uint32) + 128) // 257
        return PIL.Image.fromarray(levels.astype(np.uint8)).convert("RGB")
    if image.mode in ("I", "F"):
        raise ValueError(f"pixels of 32 bits (kind {image.mode}), expected 8 or 16 bits")
    return image.convert("RGB")


def bilinear(image: UInt8, uvs: AnyFloat) -> Float32:
    """Sample an image between its texels.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3), uint8
    uvs : ndarray of shape (N, 2)
        0..1 from the upper left corner of the upper left texel; clamped at the border.

    Returns
    -------
    ndarray of shape (N, 3), float32
    """
    height, width = image.shape[:2]
    x = np.clip(uvs[:, 0] * width - 0.5, 0.0, width - 1.0)
    y = np.clip(uvs[:, 1] * height - 0.5, 0.0, height - 1.0)
    left, top = x.astype(np.int64), y.astype(np.int64)
    right, low = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    s, t = (x - left)[:, None].astype(np.float32), (y - top)[:, None].astype(np.float32)
    over = image[top, left] * (1 - s) + image[top, right] * s
    under = image[low, left] * (1 - s) + image[low, right] * s
    mixed: Float32 = (over * (1 - t) + under * t).astype(np.float32)
    return mixed


def textured_colours(
    texturing: Texturing,
    vertices: Float32,
    faces: Int32,
    hits: Hits,
    pixel_m: AnyFloat,
    colours: Float32,
) -> None:
    """Paint the textures' colours over those of the hits that have one, in place.

    Parameters
    ----------
    texturing : Texturing
    vertices, faces : ndarray
        Of the mesh hit, metres.
    hits : Hits
        R rays, all of which met the mesh.
    pixel_m : ndarray of shape (R,)
        Width of a pixel at each hit, metres.
    colours : ndarray of shape (R, 3), float32
        sRGB 0..255; changed.
    """
    image = texturing.image_of_face[hits.face]
    order = np.flatnonzero(image >= 0)
    if len(order) == 0:
        return
    order = order[np.argsort(image[order], kind="stable")]
    corners = faces[hits.face[order]]
    u, v = hits.u[order, None], hits.v[order, None]
    first, second, third = (texturing.uvs[corners[:, k]] for k in range(3))
    uvs = first * (1 - u - v) + second * u + third * v
    stretch = _uv_per_m(vertices, corners, first, second, third) * pixel_m[order]
    starts = np.flatnonzero(np.diff(image[order], prepend=-1))
    for begin, end in zip(starts, [*starts[1:], len(order)], strict=True):
        rows = order[begin:end]
        number = int(image[rows[0]])
        width, height = texturing.images.size(number)
        texels = float(np.median(stretch[begin:end])) * (width * height) ** 0.5
        halvings = int(np.clip(np.floor(np.log2(max(texels, 1e-6)) + 0.25), 0, MAX_HALVINGS))
        pixels = texturing.images.get(number, halvings)
        colours[rows] = bilinear(pixels, uvs[begin:end])


def _uv_per_m(
    vertices: Float32, corners: Int32, first: Float32, second: Float32, third: Float32
) -> Float64:
    """Share of the image's side that a metre on each face takes, (R,)."""
    a, b = second - first, third - first
    flat = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    p, q, r = (vertices[corners[:, k]] for k in range(3))
    normal = np.cross(q - p, r - p)
    area = np.sqrt(np.einsum("ij,ij->i", normal, normal))
    result: Float64 = np.sqrt(flat / np.maximum(area, 1e-12))
    return result
