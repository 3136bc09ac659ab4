from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from terraport_payload import SegmentMesh, encode_glb, order_for_cache
from terraport_payload.order import cache_order


@given(st.integers(1, 60), st.integers(3, 30), st.integers(0, 2**32 - 1))
def test_order_is_a_permutation_even_with_duplicates(count: int, vertices: int, seed: int) -> None:
    faces = np.random.default_rng(seed).integers(0, vertices, (count, 3)).astype(np.uint32)
    order = order_for_cache(faces)
    assert np.array_equal(np.sort(order), np.arange(count))


def test_ordered_faces_lose_nothing_when_their_order_is_kept(patch: SegmentMesh) -> None:
    """Order first, number then: as small as letting the encoder reorder."""
    shuffled = patch.faces[np.random.default_rng(1).permutation(len(patch.faces))]

    def size(faces: np.ndarray, *, keep: bool) -> int:
        mesh = SegmentMesh(patch.positions, faces, patch.normals)
        return len(encode_glb(mesh, step_m=2.0**-12, attribute_scales={}, keep_face_order=keep))

    free = size(shuffled, keep=False)
    assert size(shuffled[order_for_cache(shuffled)], keep=True) <= free * 1.02
    assert size(shuffled, keep=True) > free * 1.05


def test_unused_vertices_come_last_in_their_order() -> None:
    mesh = SegmentMesh(
        positions=np.zeros((6, 3), dtype=np.float32),
        faces=np.array([[5, 2, 0]], dtype=np.uint32),
        normals=np.zeros((6, 3), dtype=np.float32),
    )
    faces, order = cache_order(mesh, keep_face_order=True)
    assert faces.tolist() == [[0, 1, 2]]
    assert order.tolist() == [5, 2, 0, 1, 3, 4]


def test_unused_vertices_after_the_last_used_one() -> None:
    mesh = SegmentMesh(
        positions=np.zeros((5, 3), dtype=np.float32),
        faces=np.array([[2, 1, 0]], dtype=np.uint32),
        normals=np.zeros((5, 3), dtype=np.float32),
    )
    assert cache_order(mesh, keep_face_order=True)[1].tolist() == [2, 1, 0, 3, 4]
