from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from payload.images import ktx2, pillow, png

from terraport_payload import PayloadError, Texture
from terraport_payload.texture import (
    MAX_IMAGE_BYTES,
    gpu_texture_bytes,
    read_image_header,
    texel_bits,
)

KINDS = {
    "png": (png(), "image/png"),
    "jpeg": (pillow("JPEG"), "image/jpeg"),
    "progressive": (pillow("JPEG", progressive=True), "image/jpeg"),
    "webp": (pillow("WEBP"), "image/webp"),
    "lossless": (pillow("WEBP", lossless=True), "image/webp"),
    "ktx2": (ktx2(), "image/ktx2"),
}


@pytest.mark.parametrize("name", KINDS)
def test_sides_are_read_from_the_header(name: str) -> None:
    data, media_type = KINDS[name]
    assert read_image_header(data) == (media_type, 16, 8)
    assert Texture.of(data) == Texture(data, media_type, 16, 8)


def test_webp_with_an_extended_header() -> None:
    data = pillow("WEBP", exif=b"Exif\0\0II*\0" + bytes(8))
    assert data[12:16] == b"VP8X"
    assert read_image_header(data) == ("image/webp", 16, 8)


def test_a_jpeg_with_other_segments_first() -> None:
    data = pillow("JPEG", comment=b"x" * 300)
    padded = data[:2] + b"\xff\xff" + data[3:]  # a fill byte before the first marker
    assert read_image_header(padded) == ("image/jpeg", 16, 8)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "starts with b''"),
        (b"GIF89a" + bytes(20), "expected one of image/jpeg"),
        (b"RIFF\0\0\0\0WAVE" + bytes(20), "expected one of"),
        (b"RIFF\0\0\0\0WEBPXYZ " + bytes(20), "expected VP8, VP8L or VP8X"),
        (png()[:20], "cut short"),
        (ktx2()[:24], "cut short"),
        (b"\x89PNG\r\n\x1a\n" + struct.pack(">I4s", 13, b"IDAT") + bytes(16), "expected b'IHDR'"),
        (b"\xff\xd8\xff\xd9\0\2", "without a frame header before its first scan"),
        (b"\xff\xd8\xff\xe0\0\x10", "without a frame header"),
        (b"\xff\xd8\xff\xc0\0\x10\x08\0", "cut short"),
        (b"\xff\xd8\xff\xe0\0\x02\x11\x11\x11\x11", "expected a marker"),
    ],
)
def test_a_header_that_is_none(data: bytes, message: str) -> None:
    with pytest.raises(PayloadError, match=message):
        read_image_header(data)


@pytest.mark.parametrize("sides", [(16, 9), (0, 8), (8192, 8), (8, 65535), (24, 8)])
def test_sides_are_powers_of_two_up_to_4096(sides: tuple[int, int]) -> None:
    with pytest.raises(PayloadError, match="powers of two"):
        Texture.of(ktx2(*sides))


def test_what_is_stated_must_be_what_the_header_says() -> None:
    with pytest.raises(PayloadError, match="16 x 8 pixels by its header, expected image/png of 8"):
        Texture(png(), "image/png", 8, 8)
    with pytest.raises(PayloadError, match="expected image/jpeg"):
        Texture(png(), "image/jpeg", 16, 8)
    with pytest.raises(PayloadError, match="at most"):
        Texture(png() + bytes(MAX_IMAGE_BYTES), "image/png", 16, 8)


@given(st.sampled_from([data for data, _ in KINDS.values()]), st.data())
def test_any_bytes_give_a_size_or_our_error(data: bytes, draw: st.DataObject) -> None:
    changed = bytearray(data[: draw.draw(st.integers(0, len(data)))])
    for _ in range(draw.draw(st.integers(0, 3))):
        if changed:
            at = draw.draw(st.integers(0, min(len(changed) - 1, 400)))
            changed[at] = draw.draw(st.integers(0, 255))
    try:
        media_type, width, height = read_image_header(bytes(changed))
    except PayloadError:
        return
    assert media_type.startswith("image/")
    assert width >= 0
    assert height >= 0


@pytest.mark.parametrize(("scheme", "bits"), [(0, 8), (1, 4), (2, 8)])
def test_a_gpu_keeps_basis_textures_compressed(scheme: int, bits: int) -> None:
    assert texel_bits(ktx2(16, 8, scheme=scheme)) == bits
    assert texel_bits(pillow("JPEG")) == 32


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ((16, 8, 32), 4 * (128 + 32 + 8 + 2 + 1)),
        ((16, 8, 8), 16 * (8 + 2 + 1 + 1 + 1)),
        ((16, 8, 4), 8 * (8 + 2 + 1 + 1 + 1)),
        ((2048, 2048, 32), 4 * (4**12 - 1) // 3),
        ((4096, 1, 4), 8 * (1024 + 512 + 256 + 128 + 64 + 32 + 16 + 8 + 4 + 2 + 1 + 1 + 1)),
        ((0, 0, 0), 0),
    ],
)
def test_gpu_bytes_count_every_level(row: tuple[int, int, int], expected: int) -> None:
    assert gpu_texture_bytes(np.array([row], np.uint16)).tolist() == [expected]
