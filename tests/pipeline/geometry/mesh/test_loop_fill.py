"""Loose edges become loops, loops become triangles."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.loop_fill import directed_loops, fill_loop


def test_two_loops_that_touch_in_a_vertex_are_taken_apart() -> None:
    edges = np.array([[0, 1], [1, 2], [2, 0], [2, 3], [3, 4], [4, 2]])
    loops, lost = directed_loops(edges)
    assert sorted(sorted(loop.tolist()) for loop in loops) == [[0, 1, 2], [2, 3, 4]]
    assert lost == 0


def test_a_chain_that_does_not_close_is_counted_and_dropped() -> None:
    loops, lost = directed_loops(np.array([[0, 1], [1, 2], [5, 6], [6, 7], [7, 5]]))
    assert [loop.tolist() for loop in loops] == [[5, 6, 7]]
    assert lost == 2


def test_two_opposite_edges_make_no_loop() -> None:
    loops, lost = directed_loops(np.array([[0, 1], [1, 0]]))
    assert loops == []
    assert lost == 0


def test_the_order_of_edges_does_not_matter() -> None:
    edges = np.array([[4, 0], [0, 9], [9, 4], [1, 2], [2, 3], [3, 1]])
    first, _ = directed_loops(edges)
    again, _ = directed_loops(edges[::-1])
    assert [loop.tolist() for loop in first] == [loop.tolist() for loop in again]


def test_a_filled_loop_has_the_loop_as_its_border() -> None:
    angle = np.linspace(0, 2 * np.pi, 9, endpoint=False)
    loop = np.stack([np.cos(angle), 0.1 * np.sin(3 * angle), np.sin(angle)], axis=1)
    faces = fill_loop(loop)
    assert faces.shape == (7, 3)
    edges = [tuple(edge) for f in faces.tolist() for edge in zip(f, f[1:] + f[:1], strict=True)]
    border = {edge for edge in edges if edge[::-1] not in edges}
    assert border == {(i, (i + 1) % 9) for i in range(9)}


def test_the_least_area_is_found() -> None:
    # A dart: the other diagonal would leave the outline.
    dart = np.array([[0.0, 0, 0], [2, 0, 0], [0.5, 0.5, 0], [0, 2, 0]])
    faces = fill_loop(dart)
    a, b, c = (dart[faces[:, corner]] for corner in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert area == 1.0


def test_a_long_sliver_is_filled_across() -> None:
    """Two polylines along a wall that part and meet again 900 places on: one surface, no more."""
    rng = np.random.default_rng(3)
    x = np.arange(451.0)
    gap = 0.8 * np.sin(np.pi * x / 450) + 0.02
    low = np.stack([x, rng.uniform(-0.1, 0.1, 451) - gap, 0 * x], axis=1)
    high = np.stack([x + 0.3, rng.uniform(-0.1, 0.1, 451) + gap, 0 * x], axis=1)
    loop = np.concatenate([low, high[::-1]])
    faces = fill_loop(loop)
    assert faces.shape == (len(loop) - 2, 3)
    # Every edge of the loop once, its way; every other edge once each way.
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert len(np.unique(sides, axis=0)) == len(sides)
    around = {(i, (i + 1) % len(loop)) for i in range(len(loop))}
    directed = set(map(tuple, sides.tolist()))
    assert around <= directed
    assert all((v, u) in directed for u, v in directed - around)
    # No more than the sliver: nowhere do triangles fold over each other.
    corners = loop[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    turned = loop[:, 0] * np.roll(loop[:, 1], -1) - np.roll(loop[:, 0], -1) * loop[:, 1]
    area = 0.5 * np.linalg.norm(normal, axis=1).sum()
    assert area == pytest.approx(0.5 * abs(turned.sum()), rel=0.01)
