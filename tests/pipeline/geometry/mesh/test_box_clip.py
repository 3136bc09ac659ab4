"""A surface cut along a rectangle: nothing lost, nothing outside, values linear."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from terraport_pipeline.geometry.mesh.box_clip import clip_to_box


def grid(cells: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A square of 8 x 8 m, its inner vertices moved about, with two values that are linear."""
    rng = np.random.default_rng(seed)
    line = np.linspace(0.0, 8.0, cells + 1)
    x, z = (axis.copy() for axis in np.meshgrid(line, line, indexing="ij"))
    for axis in (x, z):
        axis[1:-1, 1:-1] += rng.uniform(-0.3, 0.3, (cells - 1, cells - 1)) * 8 / cells
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    x, z = x.ravel(), z.ravel()
    values = np.column_stack([x, rng.uniform(0, 3, x.size), z, 3 * x - z + 1, 0.5 * z])
    return values, faces.astype(np.int32)


def area(values: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area of every face seen from above, positive where it faces up."""
    p, q, r = (values[faces[:, k]][:, [0, 2]] for k in range(3))
    a, b = q - p, r - p
    return 0.5 * (a[:, 1] * b[:, 0] - a[:, 0] * b[:, 1])


edges = st.tuples(*[st.integers(0, 32)] * 4).filter(lambda e: e[0] < e[2] and e[1] < e[3])


@example(edges=(24, 2, 30, 6), cells=1, seed=0)  # a cut's vertex beside another edge, by rounding
@given(edges=edges, cells=st.integers(1, 6), seed=st.integers(0, 99))
def test_a_box_is_filled_once(edges, cells, seed) -> None:
    # Quarters of a metre: edges of the box often lie on vertices and edges of the mesh.
    x0, z0, x1, z1 = (edge / 4 for edge in edges)
    values, faces = grid(cells, seed)
    cut = clip_to_box(values, faces, (x0, z0, x1, z1))
    assert area(cut.values, cut.faces).min() > -1e-12
    assert np.isclose(area(cut.values, cut.faces).sum(), (x1 - x0) * (z1 - z0))
    x, z = cut.values[:, 0], cut.values[:, 2]
    assert (x.min(), z.min(), x.max(), z.max()) == (x0, z0, x1, z1)
    np.testing.assert_allclose(cut.values[:, 3], 3 * x - z + 1, atol=1e-9)
    np.testing.assert_allclose(cut.values[:, 4], 0.5 * z, atol=1e-9)
    # No vertex twice: the faces on both sides of an edge share what is new on it.
    assert len(np.unique(np.round(cut.values[:, [0, 2]], 9), axis=0)) == len(cut.values)
    assert set(cut.face_before.tolist()) <= set(range(len(faces)))


def test_a_box_around_it_changes_nothing_and_one_beside_it_leaves_nothing() -> None:
    values, faces = grid(4, 0)
    same = clip_to_box(values, faces, (-1.0, -1.0, 9.0, 9.0))
    np.testing.assert_array_equal(same.values, values)
    np.testing.assert_array_equal(same.faces, faces)
    assert len(clip_to_box(values, faces, (8.0, 0.0, 9.0, 8.0)).faces) == 0
    assert len(clip_to_box(values, faces, (20.0, 0.0, 30.0, 8.0)).faces) == 0


def test_neighbouring_boxes_meet_without_gap() -> None:
    values, faces = grid(5, 3)
    left = clip_to_box(values, faces, (0.0, 0.0, 3.3, 8.0))
    right = clip_to_box(values, faces, (3.3, 0.0, 8.0, 8.0))
    seam = [{tuple(row) for row in cut.values[cut.values[:, 0] == 3.3]} for cut in (left, right)]
    assert seam[0] == seam[1]
    assert len(seam[0]) > 5
