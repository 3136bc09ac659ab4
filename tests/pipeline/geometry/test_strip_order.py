"""Orders of faces in which neighbours follow each other."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from terraport_pipeline.geometry.segments.strip_order import strip_order


@given(seed=st.integers(0, 1 << 30), faces=st.integers(0, 80), vertices=st.integers(3, 40))
def test_every_face_comes_once_whatever_the_mesh(seed: int, faces: int, vertices: int) -> None:
    corners = np.random.default_rng(seed).integers(0, vertices, (faces, 3))
    assert sorted(strip_order(corners).tolist()) == list(range(faces))


def test_in_a_lattice_nearly_every_face_shares_an_edge_with_the_one_before() -> None:
    side = 40
    place = np.arange(side * side).reshape(side, side)
    a, b, c, d = (place[i : side - 1 + i, j : side - 1 + j].ravel() for i in (0, 1) for j in (0, 1))
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])
    faces = faces[np.random.default_rng(0).permutation(len(faces))]
    ordered = faces[strip_order(faces)]
    shared = [
        len(set(x) & set(y))
        for x, y in zip(ordered[1:].tolist(), ordered[:-1].tolist(), strict=True)
    ]
    assert np.mean(np.array(shared) == 2) > 0.9
