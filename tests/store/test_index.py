from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from terraport_payload import PayloadError
from terraport_payload.flatfile import decode_flat, encode_flat
from terraport_store import SegmentIndex
from terraport_store.index import INDEX_MAGIC


def index_of(count: int = 3) -> SegmentIndex:
    low = np.arange(count * 3, dtype=np.float32).reshape(count, 3)
    return SegmentIndex(
        bounds=np.hstack([low, low + 2]),
        vertex_count=np.full(count, 10, dtype=np.uint32),
        face_count=np.arange(1, count + 1, dtype=np.uint32),
        offset=64 + 128 * np.arange(count, dtype=np.uint64),
        length=np.full(count, 100, dtype=np.uint32),
        xxh3=np.full(count, 2**64 - 1, dtype=np.uint64),
        region=np.zeros(count, dtype=np.uint32),
        region_count=np.ones(count, dtype=np.uint16),
        texture=np.zeros((count, 3), dtype="<u2"),
    )


@pytest.mark.parametrize("count", [0, 1, 3])
def test_round_trip(count: int) -> None:
    index = index_of(count)
    back = SegmentIndex.from_bytes(index.to_bytes())
    for field in fields(index):
        assert getattr(back, field.name).tobytes() == getattr(index, field.name).tobytes()
    assert back.to_bytes() == index.to_bytes()
    assert len(back) == count


def test_sums() -> None:
    assert index_of().payload_bytes == 300
    assert index_of().end == 64 + 2 * 128 + 100
    assert index_of(0).end == 0


def test_at_most_128_bytes_per_segment() -> None:
    many = len(index_of(1001).to_bytes()) - len(index_of(1).to_bytes())
    assert many <= 1000 * 66


def test_every_truncation_and_flipped_byte_is_noticed() -> None:
    data = index_of().to_bytes()
    for size in range(len(data)):
        with pytest.raises(PayloadError):
            SegmentIndex.from_bytes(data[:size])
    for position in range(len(data)):
        damaged = bytearray(data)
        damaged[position] ^= 0x20
        with pytest.raises(PayloadError):
            SegmentIndex.from_bytes(bytes(damaged))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bounds": np.zeros((3, 5), dtype=np.float32)}, r"'bounds' is float32 \(3, 5\), expected"),
        ({"length": np.ones(2, dtype=np.uint32)}, r"'length' is uint32 \(2,\)"),
        ({"xxh3": np.zeros(3, dtype=np.int64)}, "'xxh3' is int64"),
        ({"bounds": np.full((3, 6), np.nan, dtype=np.float32)}, "segment 0: box is not finite"),
        (
            {"bounds": np.array([[0] * 6, [0] * 6, [1, 0, 0, 0, 9, 9]], dtype=np.float32)},
            "segment 2: box is not finite or turned over",
        ),
        ({"face_count": np.array([1, 0, 1], dtype=np.uint32)}, "segment 1: no vertex, face"),
        ({"offset": np.array([64, 163, 500], dtype=np.uint64)}, "segment 1: payload starts before"),
        (
            {"offset": np.array([64, 200, 2**64 - 1], dtype=np.uint64)},
            "segment 2: payload runs",
        ),
    ],
)
def test_refuses(change: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(PayloadError, match=message):
        replace(index_of(), **change)


def test_missing_field_and_wrong_count() -> None:
    _, columns = decode_flat(index_of().to_bytes(), INDEX_MAGIC)
    with pytest.raises(PayloadError, match="index of 3 segments, expected 4"):
        SegmentIndex.from_bytes(encode_flat(INDEX_MAGIC, 4, columns))
    del columns["region"]
    with pytest.raises(PayloadError, match="no field 'region' in the index"):
        SegmentIndex.from_bytes(encode_flat(INDEX_MAGIC, 3, columns))


def test_further_fields_are_skipped() -> None:
    """What a later minor version may add."""
    _, columns = decode_flat(index_of().to_bytes(), INDEX_MAGIC)
    columns["roughness"] = np.zeros(3, dtype=np.float32)
    assert len(SegmentIndex.from_bytes(encode_flat(INDEX_MAGIC, 3, columns))) == 3


@pytest.mark.parametrize("largest", [(0, 0, 0), (512, 512, 32)])
def test_textures_that_a_file_does_not_tell_are_the_largest_there_can_be(
    largest: tuple[int, int, int],
) -> None:
    _, columns = decode_flat(index_of().to_bytes(), INDEX_MAGIC)
    del columns["texture"]
    index = SegmentIndex.from_bytes(encode_flat(INDEX_MAGIC, 3, columns), largest=largest)
    assert index.texture.tolist() == [list(largest)] * 3
