"""The piece of the base's image that a part of the base needs, as an image of its own.

A part of the base has faces of many charts, all over the atlas. What they look at is cut out as
rectangles, with the gutters around, and packed anew. They are moved by whole blocks of the JPEG and
encoded with its own tables, which changes next to nothing, and takes no more bytes.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from terraport_payload import SegmentMesh, Texture
from terraport_payload.types import Bool, Float32, Float64, Int64, UInt8, UInt32

__all__ = ["BaseImage"]

_GUTTER: Final = 8
"""Pixels around a chart: as much as trilinear filtering mixes in at the first three mips."""

_BLOCK: Final = 16
"""Sides of a block of JPEG whose colours have half the resolution; others divide it."""

_UNUSED: Final = 128
"""Level of blocks that no face looks at: next to no bytes."""

_QUALITY: Final = 90
"""Of JPEG made of another format."""

_FORMATS: Final = {"image/jpeg": "JPEG", "image/png": "PNG", "image/webp": "JPEG"}
"""What is written for what is read; KTX2 is not read."""


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """Rectangles in the new image."""

    corners: Int64
    """(R, 2) column and row of each upper left corner."""
    width: int
    height: int


class BaseImage:
    """The base's image, decoded once.

    Parameters
    ----------
    texture : Texture
        Of the base.

    Raises
    ------
    ModuleNotFoundError
        When Pillow is not installed.
    """

    def __init__(self, texture: Texture) -> None:
        self._texture = texture
        self._pixels: UInt8 | None = None
        self._jpeg: dict[str, Any] = {"quality": _QUALITY}
        if texture.media_type in _FORMATS:
            from PIL import Image, JpegImagePlugin

            # Its header was compared with the stated sides, 4096 at most, when it was read.
            with Image.open(io.BytesIO(texture.data)) as image:
                if isinstance(image, JpegImagePlugin.JpegImageFile) and image.mode == "RGB":
                    self._jpeg = {
                        "qtables": image.quantization,
                        "subsampling": JpegImagePlugin.get_sampling(image),
                    }
                self._pixels = np.asarray(image.convert("RGB"))

    def cut(self, part: SegmentMesh) -> SegmentMesh:
        """Give a part of the base an image of its own, and coordinates in it.

        Parameters
        ----------
        part : SegmentMesh
            With the base's texture coordinates.

        Returns
        -------
        SegmentMesh
            With the whole image where that is no larger, or cannot be decoded here (KTX2).
        """
        if self._pixels is None or part.uvs is None:
            return part
        texture = self._texture
        sides = np.array([texture.width, texture.height])
        texels = part.uvs.astype(np.float64) * sides
        # (1) One rectangle for each piece of a chart.
        chart = _charts(part.uvs, part.faces)
        _, chart = np.unique(chart, return_inverse=True)
        count = int(chart.max()) + 1
        low = np.full((count, 2), np.inf)
        high = np.full((count, 2), -np.inf)
        np.minimum.at(low, chart, texels)
        np.maximum.at(high, chart, texels)
        low = np.maximum(np.floor((low - _GUTTER) / _BLOCK) * _BLOCK, 0).astype(np.int64)
        high = np.ceil((high + _GUTTER) / _BLOCK).astype(np.int64) * _BLOCK
        high = np.minimum(high, sides)
        # (2) Where they go. No gain: all parts then share the bytes, if not the memory.
        places = _pack(high - low, sides)
        if places is None or places.width * places.height >= texture.width * texture.height:
            return part
        pixels = np.full((places.height, places.width, 3), _UNUSED, np.uint8)
        used = _used_blocks(texels[part.faces], sides).repeat(_BLOCK, 0).repeat(_BLOCK, 1)
        for (x, y), (left, top), (right, bottom) in zip(
            places.corners.tolist(), low.tolist(), high.tolist(), strict=True
        ):
            place = np.s_[y : y + bottom - top, x : x + right - left]
            piece = np.s_[top:bottom, left:right]
            np.copyto(pixels[place], self._pixels[piece], where=used[piece][..., None])
        moved = texels + (places.corners - low)[chart]
        uvs = (moved / [places.width, places.height]).astype(np.float32)
        return SegmentMesh(
            part.positions,
            part.faces,
            part.normals,
            part.colours,
            part.region_ids,
            part.attributes,
            uvs,
            Texture.of(self._encode(pixels)),
        )

    def _encode(self, pixels: UInt8) -> bytes:
        from PIL import Image

        form = _FORMATS[self._texture.media_type]
        out = io.BytesIO()
        options = {"optimize": True, **self._jpeg} if form == "JPEG" else {}
        Image.fromarray(pixels).save(out, form, **options)
        return out.getvalue()


def _charts(uvs: Float32, faces: UInt32) -> Int64:
    """Return the chart of each vertex: faces join them, equal places in the image are one."""
    _, place = np.unique(uvs, axis=0, return_inverse=True)
    corners = place.reshape(-1)[faces]
    label = np.arange(int(corners.max()) + 1)
    while True:
        least = label[corners].min(axis=1)
        lower = label.copy()
        np.minimum.at(lower, corners.ravel(), np.repeat(least, 3))
        # A label is a place of the same chart: whatever that has been joined to, so is this.
        lower = lower[lower]
        if (lower == label).all():
            return label[place.reshape(-1)]
        label = lower


def _used_blocks(corners: Float64, sides: Int64) -> Bool:
    """Tell which blocks of the image faces (F, 3, 2), in texels, look at, gutters included."""
    columns, rows = -(-sides // _BLOCK)
    first = np.floor((corners.min(axis=1) - _GUTTER) / _BLOCK).astype(np.int64)
    after = np.floor((corners.max(axis=1) + _GUTTER) / _BLOCK).astype(np.int64) + 1
    first = np.maximum(first, 0)
    after = np.minimum(after, [columns, rows])
    # Boxes as differences; sums along both axes say how many lie over each block.
    change = np.zeros((rows + 1, columns + 1), dtype=np.int64)
    for x, y, sign in (
        (first[:, 0], first[:, 1], 1),
        (after[:, 0], after[:, 1], 1),
        (after[:, 0], first[:, 1], -1),
        (first[:, 0], after[:, 1], -1),
    ):
        np.add.at(change, (y, x), sign)
    over: Bool = change.cumsum(axis=0).cumsum(axis=1)[:rows, :columns] > 0
    return over


def _pack(sizes: Int64, most: Int64) -> _Places | None:
    """Put rectangles (R, 2) on shelves of the smallest image of powers of two; None: no room."""
    order = np.lexsort((-sizes[:, 0], -sizes[:, 1]))
    area = int(sizes.prod(axis=1).sum())
    widest, tallest = sizes.max(axis=0).tolist()
    tried = [
        (1 << across, 1 << down)
        for across in range(int(most[0]).bit_length())
        for down in range(int(most[1]).bit_length())
        if 1 << across >= widest and 1 << down >= tallest and 1 << across + down >= area
    ]
    # Of equal areas the squarest.
    for width, height in sorted(tried, key=lambda size: (size[0] * size[1], max(size))):
        corners = np.zeros_like(sizes)
        x = y = shelf = 0
        for number in order.tolist():
            across, down = sizes[number].tolist()
            if x + across > width:
                x, y, shelf = 0, y + shelf, 0
            if y + down > height:
                break
            corners[number] = x, y
            x, shelf = x + across, max(shelf, down)
        else:
            return _Places(corners, width, height)
    return None
