from __future__ import annotations

import numpy as np
import pytest

from terraport_payload import Cover, PayloadError
from terraport_payload.cover import COVER_MAGIC
from terraport_payload.flatfile import encode_flat


def u32(*values: int) -> np.ndarray:
    return np.array(values, dtype=np.uint32)


def test_round_trip() -> None:
    cover = Cover(u32(0, 2, 2, 3), u32(1, 5, 0))
    back = Cover.from_bytes(cover.to_bytes())
    assert [back.over(face).tolist() for face in range(back.base_faces)] == [[1, 5], [], [0]]
    assert back.to_bytes() == cover.to_bytes()


def test_no_base_face() -> None:
    assert Cover.from_bytes(Cover(u32(0), u32()).to_bytes()).base_faces == 0


@pytest.mark.parametrize("face", [-1, 3])
def test_no_such_face(face: int) -> None:
    with pytest.raises(IndexError, match=f"base face {face}, expected 0 to 2"):
        Cover(u32(0, 2, 2, 3), u32(1, 5, 0)).over(face)


@pytest.mark.parametrize(
    ("offsets", "segments", "message"),
    [
        (u32(), u32(), r"run \[\]"),
        (u32(1, 2), u32(0, 0), r"run \[1, 2\], expected 0 to 2"),
        (u32(0, 1), u32(0, 0), r"run \[0, 1\], expected 0 to 2"),
        (u32(0, 2, 1, 2), u32(0, 0), "decrease at base face 1"),
        (np.zeros(1, dtype=np.int64), u32(), "offsets are int64"),
        (u32(0), np.zeros((0, 2), dtype=np.uint32), "segments are uint32"),
    ],
)
def test_refuses(offsets: np.ndarray, segments: np.ndarray, message: str) -> None:
    with pytest.raises(PayloadError, match=message):
        Cover(offsets, segments)


def test_every_truncation_and_flipped_byte_is_noticed() -> None:
    data = Cover(u32(0, 2, 2, 3), u32(1, 5, 0)).to_bytes()
    for size in range(len(data)):
        with pytest.raises(PayloadError):
            Cover.from_bytes(data[:size])
    for position in range(len(data)):
        damaged = bytearray(data)
        damaged[position] ^= 0x10
        with pytest.raises(PayloadError):
            Cover.from_bytes(bytes(damaged))


def test_missing_field_and_wrong_count() -> None:
    with pytest.raises(PayloadError, match="no field 'segments'"):
        Cover.from_bytes(encode_flat(COVER_MAGIC, 0, {"offsets": u32(0)}))
    data = encode_flat(COVER_MAGIC, 4, {"offsets": u32(0, 0), "segments": u32()})
    with pytest.raises(PayloadError, match="cover of 1 base faces, expected 4"):
        Cover.from_bytes(data)
