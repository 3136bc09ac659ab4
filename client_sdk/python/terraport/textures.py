"""Images of textured payloads for their users: decoded, put together, read at vertices.

Needs Pillow, which the light core does not bring; everything else of the SDK works without.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from terraport.errors import MissingExtraError, UsageError
from terraport_payload import SegmentMesh, Texture
from terraport_payload.texture import MAX_SIDE
from terraport_payload.types import Float32, Int64, UInt8

if TYPE_CHECKING:
    import PIL.Image

__all__ = ["decode_texture", "merge_textures", "open_texture", "vertex_colours"]

_QUALITY: Final = 92
"""JPEG quality of an image put together: it was encoded once already."""

_LEAST_SIDE: Final = 16


def open_texture(texture: Texture) -> PIL.Image.Image:
    """Return a payload's image, not decoded yet.

    Raises
    ------
    MissingExtraError
        Pillow is not installed.
    UsageError
        Pillow cannot read it: KTX2, or damaged.
    """
    try:
        import PIL.Image
    except ImportError:
        raise MissingExtraError("a texture's pixels", "pillow") from None
    try:
        return PIL.Image.open(io.BytesIO(texture.data))
    except (OSError, SyntaxError, ValueError):
        raise UsageError(
            f"{texture.media_type} is an image that Pillow cannot read, expected JPEG, PNG or WebP"
        ) from None


def decode_texture(texture: Texture) -> UInt8:
    """Return a payload's pixels, (height, width, 3) sRGB, row 0 the top; raises as opening does."""
    image = open_texture(texture)
    try:
        return np.asarray(image.convert("RGB"))
    except (OSError, SyntaxError, ValueError) as error:
        raise UsageError(f"{texture.media_type} does not decode: {error}") from None


def vertex_colours(mesh: SegmentMesh) -> UInt8 | None:
    """Return a colour for every vertex: its own, or the texel nearest to it.

    Returns
    -------
    ndarray of shape (V, 3), uint8, or None
        sRGB; None for a mesh with neither.

    Raises
    ------
    MissingExtraError, UsageError
        As :func:`open_texture`; for textured meshes alone.
    """
    if mesh.texture is None or mesh.uvs is None:
        return mesh.colours
    pixels = decode_texture(mesh.texture)
    size = np.array([mesh.texture.width, mesh.texture.height])
    column, row = np.clip((mesh.uvs * size).astype(np.int64), 0, size - 1).T
    colours: UInt8 = pixels[row, column]
    return colours


def merge_textures(meshes: Sequence[SegmentMesh]) -> tuple[Float32, Texture]:
    """Put the images of several meshes into one.

    Parameters
    ----------
    meshes : sequence of SegmentMesh
        At least one, all with texture.

    Returns
    -------
    uvs : ndarray of shape (V, 2), float32
        Of all vertices, mesh after mesh.
    texture : Texture
        JPEG of at most 4096 x 4096; images are halved until all fit.

    Raises
    ------
    MissingExtraError, UsageError
        As :func:`open_texture`, and when even the smallest images would not fit.
    """
    if len(meshes) == 1 and meshes[0].uvs is not None and meshes[0].texture is not None:
        return meshes[0].uvs, meshes[0].texture
    images = [open_texture(mesh.texture).convert("RGB") for mesh in meshes if mesh.texture]
    sizes = np.array([image.size for image in images], dtype=np.int64)
    while True:
        placed = _shelves(sizes)
        if placed is not None:
            break
        if sizes.max() <= _LEAST_SIDE:
            raise UsageError(
                f"{len(meshes)} textures, expected fewer: they do not fit {MAX_SIDE} x {MAX_SIDE}"
            )
        sizes = np.where(sizes > _LEAST_SIDE, sizes // 2, sizes)
    places, width, height = placed
    whole = np.zeros((height, width, 3), dtype=np.uint8)
    for image, (x, y), (across, down) in zip(images, places, sizes.tolist(), strict=True):
        small = image if image.size == (across, down) else image.resize((across, down))
        whole[y : y + down, x : x + across] = np.asarray(small)
    uvs = [
        (place + mesh.uvs * size) / (width, height)
        for mesh, place, size in zip(meshes, places, sizes, strict=True)
        if mesh.uvs is not None
    ]
    return np.concatenate(uvs).astype(np.float32), _encoded(whole)


def _encoded(pixels: UInt8) -> Texture:
    import PIL.Image

    out = io.BytesIO()
    PIL.Image.fromarray(pixels).save(out, "JPEG", quality=_QUALITY, subsampling="4:4:4")
    return Texture.of(out.getvalue())


def _shelves(sizes: Int64) -> tuple[Int64, int, int] | None:
    """Place rectangles of powers of two in rows, the high ones first."""
    order = np.lexsort((np.arange(len(sizes)), -sizes[:, 0], -sizes[:, 1]))
    area = int((sizes[:, 0] * sizes[:, 1]).sum())
    width = int(sizes[:, 0].max())
    while width * width < area:
        width *= 2
    while width <= MAX_SIDE:
        places = np.zeros_like(sizes)
        x = y = row = 0
        for number in order.tolist():
            across, down = sizes[number].tolist()
            if x + across > width:
                x, y, row = 0, y + row, 0
            places[number] = x, y
            x, row = x + across, max(row, down)
        height = 1
        while height < y + row:
            height *= 2
        if height <= MAX_SIDE:
            return places, width, height
        width *= 2
    return None
