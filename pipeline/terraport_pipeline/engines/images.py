"""Image files of textures: JPEG, WebP and PNG by Pillow, KTX2 by a program of its own."""

from __future__ import annotations

import io
from typing import Any, Final

import numpy as np
import PIL.Image

from terraport_payload import PayloadError
from terraport_payload.texture import read_image_header
from terraport_payload.types import UInt8
from terraport_pipeline.engines.ktx2 import encode_ktx2
from terraport_pipeline.errors import EngineError
from terraport_pipeline.options.texture import ImageFormat

__all__ = ["MEDIA_TYPES", "decode_image", "encode_image"]


MEDIA_TYPES: Final[dict[str, str]] = {
    "jpeg": "image/jpeg",
    "webp": "image/webp",
    "png": "image/png",
    "ktx2": "image/ktx2",
}
"""Media type by the name of a format."""

_MAX_PIXELS: Final = 1 << 26
"""8192 x 8192: four times the largest texture there is."""

_WEBP_METHOD: Final = 2
"""Of 0 (fast) to 6: a third of the time of the default 4 for 3 % more bytes."""


def encode_image(pixels: UInt8, kind: ImageFormat, quality: int) -> bytes:
    """Encode an image.

    Parameters
    ----------
    pixels : ndarray of shape (H, W, 3), uint8
        sRGB.
    kind : {"jpeg", "webp", "png", "ktx2"}
    quality : int
        1 to 100; PNG has none.

    Returns
    -------
    bytes
        Same input, same bytes (of one release of Pillow's codecs). JPEG has its colour at half the
        resolution (4:2:0); releases the interpreter's lock.
    """
    if kind == "ktx2":
        return encode_ktx2(pixels, quality)
    out = io.BytesIO()
    options: dict[str, dict[str, Any]] = {
        "jpeg": {"quality": quality, "subsampling": "4:2:0", "optimize": True},
        "webp": {"quality": quality, "method": _WEBP_METHOD},
        "png": {"compress_level": 6},
    }
    PIL.Image.fromarray(pixels).save(out, kind.upper(), **options[kind])
    return out.getvalue()


def decode_image(data: bytes) -> UInt8:
    """Decode a texture's image.

    Parameters
    ----------
    data : bytes
        JPEG, WebP or PNG.

    Returns
    -------
    ndarray of shape (H, W, 3), uint8
        sRGB.

    Raises
    ------
    EngineError
        When Pillow cannot read it, it is KTX2, or its header claims more than 2^26 pixels.
    """
    try:
        media_type, width, height = read_image_header(data)
        if media_type == MEDIA_TYPES["ktx2"] or width * height > _MAX_PIXELS:
            raise EngineError(
                f"{media_type} of {width} x {height} pixels; expected JPEG, WebP or PNG of at most "
                f"{_MAX_PIXELS} pixels"
            )
        with PIL.Image.open(io.BytesIO(data)) as image:
            return np.asarray(image.convert("RGB"))
    except (PayloadError, OSError, SyntaxError, ValueError) as error:
        raise EngineError(f"an image of {len(data)} bytes does not decode: {error}") from error
