from __future__ import annotations

import struct

import numpy as np
import pytest
import xxhash
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from terraport_payload import PayloadError
from terraport_payload.flatfile import MAX_FIELDS, decode_flat, encode_flat

MAGIC = b"EXAMPLE1"
# id = [7, 8] as uint32: header 48, one entry of 96, eight bytes of data. Written out by hand.
TAIL = bytes.fromhex(
    "0100 0000 30000000 9800000000000000 01000000 60000000 02000000 00000000"
    "6964" + "00" * 70 + "05 01 0000 02000000 9000000000000000 0800000000000000"
    "07000000 08000000"
)
LITERAL = MAGIC + struct.pack("<Q", xxhash.xxh3_64_intdigest(TAIL)) + TAIL


def sealed(tail: bytes) -> bytes:
    """A file whose checksum is right whatever the rest says."""
    return MAGIC + struct.pack("<Q", xxhash.xxh3_64_intdigest(tail)) + tail


def test_literal_bytes_both_ways() -> None:
    values = np.array([7, 8], dtype=np.uint32)
    assert encode_flat(MAGIC, 2, {"id": values}) == LITERAL
    rows, fields = decode_flat(LITERAL, MAGIC)
    assert rows == 2
    assert list(fields) == ["id"]
    assert fields["id"].dtype == np.uint32
    assert fields["id"].tolist() == [7, 8]


def test_every_truncation_fails() -> None:
    for size in range(len(LITERAL)):
        with pytest.raises(PayloadError):
            decode_flat(LITERAL[:size], MAGIC)


def test_every_flipped_bit_fails() -> None:
    for position in range(len(LITERAL)):
        for bit in range(8):
            damaged = bytearray(LITERAL)
            damaged[position] ^= 1 << bit
            with pytest.raises(PayloadError):
                decode_flat(bytes(damaged), MAGIC)


def test_extra_bytes_fail() -> None:
    with pytest.raises(PayloadError, match="153 bytes, expected 152 by the header"):
        decode_flat(LITERAL + b"\0", MAGIC)


def test_wrong_magic_is_named() -> None:
    with pytest.raises(
        PayloadError, match=r"magic b'EXAMPLE1', expected b'OTHER' \(payload offset 0\)"
    ):
        decode_flat(LITERAL, b"OTHER")


def test_newer_major_is_called_that() -> None:
    with pytest.raises(PayloadError, match="format version 2, expected 1"):
        decode_flat(sealed(b"\2" + TAIL[1:]), MAGIC)


def test_newer_minor_with_longer_header_entries_and_unknown_types_is_read() -> None:
    """A later minor version: 8 more header bytes, 8 more entry bytes, a field of type 99."""
    entry = TAIL[32:128] + b"extended"
    unknown = b"new".ljust(72, b"\0") + struct.pack("<BBHIQQ", 99, 1, 0, 1, 264, 8) + b"extended"
    tail = (
        struct.pack("<HHIQIIII", 1, 7, 56, 272, 2, 104, 2, 0)
        + b"newfield"
        + entry.replace(struct.pack("<QQ", 0x90, 8), struct.pack("<QQ", 264, 8))
        + unknown
        + struct.pack("<II", 7, 8)
    )
    rows, fields = decode_flat(sealed(tail), MAGIC)
    assert rows == 2
    assert {name: values.tolist() for name, values in fields.items()} == {"id": [7, 8]}


@pytest.mark.parametrize(
    ("offset", "value", "message"),
    [
        (16, struct.pack("<I", MAX_FIELDS + 1), "257 fields"),
        (16, struct.pack("<I", 200), "runs past the end"),
        (20, struct.pack("<I", 95), "of 95 bytes"),
        (4, struct.pack("<I", 47), "at 47"),
        (32, b"\xff", "expected UTF-8"),
        (32 + 73, b"\0", "0 x uint32"),
        (32 + 76, struct.pack("<I", 3), "8 bytes for 3 rows"),
        (32 + 80, struct.pack("<Q", 0x91), "expected a multiple of 8"),
        (32 + 80, struct.pack("<Q", 1 << 63), "expected a multiple of 8 within"),
        (32 + 80, struct.pack("<Q", 152), "within the file's 152 bytes"),
    ],
)
def test_hostile_directory_with_right_checksum(offset: int, value: bytes, message: str) -> None:
    tail = TAIL[:offset] + value + TAIL[offset + len(value) :]
    with pytest.raises(PayloadError, match=message):
        decode_flat(sealed(tail), MAGIC)


def test_field_twice_fails() -> None:
    tail = struct.pack("<HHIQIIII", 1, 0, 48, 248, 2, 96, 2, 0) + TAIL[32:128] * 2 + TAIL[128:]
    with pytest.raises(PayloadError, match="'id' appears twice"):
        decode_flat(sealed(tail), MAGIC)


@given(
    st.dictionaries(
        st.text(min_size=1, max_size=18).filter(lambda name: "\0" not in name),
        st.sampled_from(["<i1", "<u1", "<i2", "<u2", "<u4", "<u8", "<f4"]).flatmap(
            lambda dtype: hnp.arrays(
                np.dtype(dtype),
                hnp.array_shapes(min_dims=1, max_dims=2, min_side=0, max_side=5).filter(
                    lambda shape: len(shape) == 1 or shape[1] >= 2
                ),
            )
        ),
        max_size=5,
    ),
    st.integers(0, 2**32 - 1),
)
def test_round_trip(fields: dict[str, np.ndarray], rows: int) -> None:
    data = encode_flat(MAGIC, rows, fields)
    back_rows, back = decode_flat(memoryview(data), MAGIC)
    assert back_rows == rows
    assert list(back) == list(fields)
    for name, values in fields.items():
        assert back[name].dtype == values.dtype
        assert back[name].shape == values.shape
        assert back[name].tobytes() == values.tobytes()
        assert not back[name].flags.writeable


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("n" * 73, np.zeros(1, dtype=np.uint8), "73 bytes of UTF-8"),
        ("", np.zeros(1, dtype=np.uint8), "0 bytes of UTF-8"),
        ("a\0b", np.zeros(1, dtype=np.uint8), "without NUL"),
        ("x", np.zeros(1, dtype=np.float64), "is float64 of 1 dimensions"),
        ("x", np.zeros((1, 2, 3), dtype=np.uint8), "of 3 dimensions"),
        ("x", np.zeros((1, 0), dtype=np.uint8), "0 components"),
    ],
)
def test_encode_refuses(name: str, values: np.ndarray, message: str) -> None:
    with pytest.raises(PayloadError, match=message):
        encode_flat(MAGIC, 1, {name: values})


def test_encode_refuses_too_many_fields() -> None:
    fields = {str(number): np.zeros(1, dtype=np.uint8) for number in range(MAX_FIELDS + 1)}
    with pytest.raises(PayloadError, match="257 fields, expected at most 256"):
        encode_flat(MAGIC, 1, fields)
