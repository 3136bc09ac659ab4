from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from payload.images import ktx2, pillow

from terraport_payload.texture import read_image_header
from terraport_pipeline.engines.images import MEDIA_TYPES, decode_image, encode_image
from terraport_pipeline.errors import EngineError


def smooth() -> Any:
    y, x = np.mgrid[:64, :128]
    return np.stack([2 * x, 4 * y, 255 - x - y], axis=2).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("kind", ["jpeg", "webp", "png"])
def test_images_come_back_nearly_as_they_went(kind: Any) -> None:
    data = encode_image(smooth(), kind, 90)
    assert read_image_header(data) == (MEDIA_TYPES[kind], 128, 64)
    error = decode_image(data).astype(int) - smooth()
    assert np.sqrt((error**2).mean()) < (1e-9 if kind == "png" else 3.0)
    assert encode_image(smooth(), kind, 90) == data


@pytest.mark.parametrize("data", [b"", b"GIF89a", ktx2(), pillow("JPEG")[:200], pillow("PNG")[:60]])
def test_what_does_not_decode(data: bytes) -> None:
    with pytest.raises(EngineError):
        decode_image(data)


def test_an_image_that_claims_to_be_huge_is_refused_unread() -> None:
    data = bytearray(pillow("PNG"))
    data[16:24] = b"\0\0\xff\xff\0\0\xff\xff"
    with pytest.raises(EngineError, match="65535 x 65535"):
        decode_image(bytes(data))
