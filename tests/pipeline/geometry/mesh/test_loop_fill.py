"""Loose edges become loops, loops become triangles."""

from __future__ import annotations

import numpy as np

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
