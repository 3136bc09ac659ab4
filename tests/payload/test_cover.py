from __future__ import annotations

import struct

import numpy as np
import pytest
import xxhash
from hypothesis import given
from hypothesis import strategies as st

from terraport_payload import Cover, PayloadError
from terraport_payload.cover import MAX_COVER_ROWS, MAX_ROW_SEGMENTS

# Rows {1}, {1, 2} twice, none, {2} for 17 faces, written out by hand: the magic and the checksum,
# which no hand can work out, come before it.
TAIL = bytes.fromhex(
    "0100 0000 20000000 15000000 16000000"
    "1f 02"  # 1, two times half ahead of 0: in; one face
    "2f 02"  # 2, 1 ahead of 1: in; two faces
    "01"  # the last but one, 1: out; no face yet
    "11"  # the last but one, 2: out; one face
    "f0 02"  # the last, 2: in; 15 and 2 faces
)
LITERAL = b"TPCOVER1" + struct.pack("<Q", xxhash.xxh3_64_intdigest(TAIL)) + TAIL


def u32(*values: int) -> np.ndarray:
    return np.array(values, dtype=np.uint32)


def test_round_trip() -> None:
    cover = Cover(u32(0, 2, 2, 3), u32(1, 5, 0))
    back = Cover.from_bytes(cover.to_bytes(), 3)
    assert [back.over(face).tolist() for face in range(back.base_faces)] == [[1, 5], [], [0]]
    assert back.to_bytes() == cover.to_bytes()


def test_no_base_face() -> None:
    assert Cover.from_bytes(Cover(u32(0), u32()).to_bytes(), 0).base_faces == 0


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
        (u32(0, 1, 3), u32(9, 4, 4), "over base face 1 do not ascend"),
        (u32(0, 0, 0, 2), u32(4, 3), "over base face 2 do not ascend"),
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
            Cover.from_bytes(data[:size], 3)
    for position in range(len(data)):
        damaged = bytearray(data)
        damaged[position] ^= 0x10
        with pytest.raises(PayloadError):
            Cover.from_bytes(bytes(damaged), 3)


ROWS = st.lists(
    st.frozensets(st.integers(0, 40) | st.integers(0, 2**32 - 1), max_size=20), max_size=6
)


@given(ROWS, st.lists(st.tuples(st.integers(0, 5), st.integers(1, 300)), max_size=12))
def test_any_cover_comes_back(rows: list[frozenset[int]], runs: list[tuple[int, int]]) -> None:
    chosen = [
        sorted(rows[which]) for which, count in runs if which < len(rows) for _ in range(count)
    ]
    offsets = np.cumsum([0, *map(len, chosen)]).astype(np.uint32)
    cover = Cover(offsets, u32(*(segment for row in chosen for segment in row)))
    back = Cover.from_bytes(cover.to_bytes(), len(chosen))
    assert back.offsets.tolist() == cover.offsets.tolist()
    assert back.segments.tolist() == cover.segments.tolist()


def test_literal_bytes_both_ways() -> None:
    rows = [[1], [1, 2], [1, 2], [], *[[2]] * 17]
    cover = Cover.from_bytes(LITERAL, 21)
    assert [cover.over(face).tolist() for face in range(21)] == rows
    assert cover.to_bytes() == LITERAL


@given(st.binary(max_size=60), st.integers(0, 40), st.integers(0, 200))
def test_any_steps_are_read_or_refused(steps: bytes, base_faces: int, entries: int) -> None:
    tail = struct.pack("<HHIII", 1, 0, 32, base_faces, entries) + steps
    data = b"TPCOVER1" + struct.pack("<Q", xxhash.xxh3_64_intdigest(tail)) + tail
    try:
        cover = Cover.from_bytes(data, base_faces)
    except PayloadError:
        return
    assert (cover.base_faces, len(cover.segments)) == (base_faces, entries)


def test_equal_neighbours_cost_nothing() -> None:
    """A run of rows is one step: what the form is for."""
    offsets = np.arange(100_001, dtype=np.uint32)
    cover = Cover(offsets, np.full(100_000, 7, dtype=np.uint32))
    assert len(cover.to_bytes()) < 40


@pytest.mark.parametrize(
    ("offsets", "message"),
    [
        (np.zeros(MAX_COVER_ROWS + 2, dtype=np.uint32), "base faces, expected at most 16777216"),
        (u32(0, MAX_ROW_SEGMENTS + 1), "4097 segments over a base face, expected at most 4096"),
    ],
)
def test_beyond_the_limits_is_not_written(offsets: np.ndarray, message: str) -> None:
    cover = Cover(offsets, np.arange(offsets[-1], dtype=np.uint32))
    with pytest.raises(PayloadError, match=message):
        cover.to_bytes()


def test_the_widest_row_comes_back() -> None:
    """Beside one that has no segment in common with it: nothing wider lies between them."""
    segments = (
        np.arange(2 * MAX_ROW_SEGMENTS, dtype=np.uint32)[::-1].reshape(2, -1)[:, ::-1].ravel()
    )
    cover = Cover(u32(0, MAX_ROW_SEGMENTS, 2 * MAX_ROW_SEGMENTS), segments)
    assert cover.segments[[0, -1]].tolist() == [MAX_ROW_SEGMENTS, MAX_ROW_SEGMENTS - 1]
    back = Cover.from_bytes(cover.to_bytes(), 2)
    assert back.segments.tolist() == segments.tolist()
