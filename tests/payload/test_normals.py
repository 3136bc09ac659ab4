from __future__ import annotations

import meshopt
import numpy as np
import pytest

from terraport_payload.normals import encode_octahedral, largest_error_deg


def sphere(count: int) -> np.ndarray:
    vectors = np.random.default_rng(3).normal(size=(count, 3))
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


def decoded(codes: np.ndarray) -> np.ndarray:
    """What the library's own filter makes of it, through the codec."""
    packed = meshopt.encode_gltf_buffer(codes, "ATTRIBUTES", 0)
    raw = meshopt.decode_gltf_buffer(packed, len(codes), 4, "ATTRIBUTES", "OCTAHEDRAL")
    signed = np.ascontiguousarray(raw).view(np.int8).reshape(-1, 4)[:, :3].astype(float)
    return signed / np.linalg.norm(signed, axis=1, keepdims=True)


@pytest.mark.parametrize("bits", [6, 7])
def test_no_normal_is_farther_off_than_by_rounding(bits: int) -> None:
    normals = sphere(20_000)
    cosine = (decoded(encode_octahedral(normals, bits)) * normals).sum(axis=1)
    # The decoder rounds to 8 bits per axis itself: up to 0.3 degrees more.
    assert np.degrees(np.arccos(cosine.min())) < largest_error_deg(bits) + 0.3
    rounded = np.zeros((len(normals), 4), np.float32)
    rounded[:, :3] = normals
    plain = (decoded(meshopt.encode_filter_oct(rounded, 4, bits)) * normals).sum(axis=1)
    assert np.degrees(np.arccos(plain.min())) < largest_error_deg(bits) + 0.3


def test_axes_come_back_exactly() -> None:
    axes = np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)
    assert np.allclose(decoded(encode_octahedral(np.repeat(axes, 3, axis=0), 7))[::3], axes)


def test_normals_of_like_ground_pack_smaller_than_rounded_ones() -> None:
    rng = np.random.default_rng(4)
    ground = np.array([0.1, 1.0, -0.2]) + rng.normal(0, 0.03, (4000, 3))
    ground = (ground / np.linalg.norm(ground, axis=1, keepdims=True)).astype(np.float32)
    wide = np.zeros((len(ground), 4), np.float32)
    wide[:, :3] = ground
    rounded = meshopt.encode_gltf_buffer(meshopt.encode_filter_oct(wide, 4, 7), "ATTRIBUTES", 0)
    ours = meshopt.encode_gltf_buffer(encode_octahedral(ground, 7), "ATTRIBUTES", 0)
    assert len(ours) < len(rounded)
