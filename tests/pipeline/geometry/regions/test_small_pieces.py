"""Small pieces join what they touch most; outlines of regions are closed."""

from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.regions.region_outlines import outline_edges, times_around
from terraport_pipeline.geometry.regions.small_pieces import absorb_small

SIDE = 12


def grid() -> tuple[np.ndarray, np.ndarray]:
    x, z = np.meshgrid(np.arange(SIDE + 1.0), np.arange(SIDE + 1.0), indexing="ij")
    index = np.arange((SIDE + 1) ** 2).reshape(SIDE + 1, SIDE + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2)
    return np.stack([x, x * 0, z], -1).reshape(-1, 3), faces.reshape(-1, 3).astype(np.int32)


def cells(of: np.ndarray) -> np.ndarray:
    """A label of each of the grid's squares, for its two faces."""
    return np.repeat(of.reshape(-1), 2).astype(np.int32)


def test_a_crumb_joins_its_longest_border_and_chains_of_them_too() -> None:
    vertices, faces = grid()
    pairs = face_pairs(faces, len(vertices))
    of = np.zeros((SIDE, SIDE), int)
    of[6:] = 1
    of[5, 3], of[5, 4] = 2, 3  # two crumbs on the side of 0: each has more border with it
    ones = np.ones(len(faces))
    joined = absorb_small(cells(of), pairs, vertices, ones, 4.0)
    of[5, 3:5] = 0
    assert (joined == cells(of)).all()


def test_what_may_not_move_and_what_is_large_stays() -> None:
    vertices, faces = grid()
    pairs = face_pairs(faces, len(vertices))
    of = np.zeros((SIDE, SIDE), int)
    of[2, 2], of[8:10, 8:10] = 5, 6
    ones = np.ones(len(faces))
    movable = cells(of) != 5
    kept = absorb_small(cells(of), pairs, vertices, ones, 9.0, movable=movable)
    assert set(kept) == {0, 5}
    assert set(absorb_small(cells(of), pairs, vertices, ones, 3.0)) == {0, 6}
    assert set(absorb_small(cells(of), pairs, vertices, ones, 1e9)) == {0}, "the whole has no other"


def test_a_region_with_a_hole_is_walked_around_once() -> None:
    vertices, faces = grid()
    of = np.zeros((SIDE, SIDE), int)
    of[3:6, 4:8] = 1
    edges, of_region = outline_edges(faces, cells(of))
    plan = vertices[:, [0, 2]] * (1, -1)  # east and north: anticlockwise from above
    assert np.bincount(of_region).tolist() == [4 * SIDE + 14, 14]
    outer = edges[of_region == 0]
    ends = plan[outer]
    places = np.array([[1.5, -1.5], [4.5, -5.5], [-1.0, -1.0]])
    around = times_around(places, ends[:, 0].copy(), ends[:, 1].copy())
    assert around.tolist() == [1, 0, 0]
    inner = plan[edges[of_region == 1]]
    assert times_around(places, inner[:, 0].copy(), inner[:, 1].copy()).tolist() == [0, 1, 0]


def test_an_edge_of_three_faces_and_one_without_length() -> None:
    faces = np.array([[0, 1, 2], [1, 0, 3], [1, 0, 4], [5, 5, 6]], np.int32)
    edges, _ = outline_edges(faces, np.zeros(4, np.int32))
    found = {tuple(edge) for edge in edges.tolist()}
    assert (1, 0) in found, "two of one way against one of the other: one is left"
    assert (0, 1) not in found
    assert not any(a == b for a, b in found)
