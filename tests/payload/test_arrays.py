from __future__ import annotations

import numpy as np
import pytest

from terraport_payload import PayloadError, SegmentMesh, decode_arrays, encode_arrays
from terraport_payload.arrays import ARRAYS_MAGIC
from terraport_payload.flatfile import encode_flat


def test_round_trip_is_exact(patch: SegmentMesh) -> None:
    back = decode_arrays(encode_arrays(patch))
    for name in ("positions", "faces", "normals", "colours", "region_ids"):
        assert getattr(back, name).tobytes() == getattr(patch, name).tobytes(), name
        assert getattr(back, name).dtype == getattr(patch, name).dtype
    assert list(back.attributes) == ["grade"]
    assert back.attributes["grade"].tobytes() == patch.attributes["grade"].tobytes()


def test_optional_arrays_may_be_absent(triangle: SegmentMesh) -> None:
    back = decode_arrays(encode_arrays(triangle))
    assert back.colours is None
    assert back.region_ids is None
    assert back.attributes == {}


def test_every_truncation_and_flipped_byte_is_noticed(triangle: SegmentMesh) -> None:
    data = encode_arrays(triangle)
    for size in range(len(data)):
        with pytest.raises(PayloadError):
            decode_arrays(data[:size])
    for position in range(len(data)):
        damaged = bytearray(data)
        damaged[position] ^= 0x04
        with pytest.raises(PayloadError):
            decode_arrays(bytes(damaged))


def test_consistent_file_with_senseless_contents_is_refused(triangle: SegmentMesh) -> None:
    """The checksum is right, the mesh is not."""

    def sealed(**change: np.ndarray) -> bytes:
        fields: dict[str, np.ndarray] = {
            "positions": triangle.positions,
            "normals": triangle.normals,
            "indices": triangle.faces,
        }
        return encode_flat(ARRAYS_MAGIC, 3, {**fields, **change})

    decode_arrays(sealed())
    with pytest.raises(PayloadError, match="a face uses vertex 9"):
        decode_arrays(sealed(indices=np.array([[0, 1, 9]], dtype=np.uint32)))
    with pytest.raises(PayloadError, match="field 'positions' is float32"):
        decode_arrays(sealed(positions=np.zeros((4, 3), dtype=np.float32)))
    with pytest.raises(PayloadError, match="field 'indices' is uint16"):
        decode_arrays(sealed(indices=np.zeros((1, 3), dtype=np.uint16)))
    with pytest.raises(PayloadError, match="no field 'positions'"):
        decode_arrays(encode_flat(ARRAYS_MAGIC, 3, {"indices": triangle.faces}))


def test_name_too_long_for_the_directory_is_refused(triangle: SegmentMesh) -> None:
    values = np.zeros(3, dtype=np.float32)
    mesh = SegmentMesh(
        triangle.positions, triangle.faces, triangle.normals, attributes={"n" * 63: values}
    )
    with pytest.raises(PayloadError, match="73 bytes of UTF-8"):
        encode_arrays(mesh)
