"""Where a vertical plane meets a surface."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.plane_section import joined_lines, vertical_cut


def box() -> tuple[np.ndarray, np.ndarray]:
    """A closed box 2 x 1 x 2 m about the origin's ground."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (0, 1) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)


def test_a_closed_body_gives_a_closed_line() -> None:
    corners, faces = box()
    (line,) = joined_lines(vertical_cut(corners, faces, (-5.0, 0.25), (5.0, 0.25)))
    assert line[0].tolist() == line[-1].tolist()
    low, high = line.min(axis=0), line.max(axis=0)
    assert (*low, *high) == pytest.approx((4.0, 0.0, 6.0, 1.0))
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert steps.sum() == pytest.approx(6.0)


def test_a_line_that_ends_within_cuts_only_so_far() -> None:
    corners, faces = box()
    lines = joined_lines(vertical_cut(corners, faces, (0.0, 0.1), (5.0, 0.1)))
    # Roof and floor begin at the line's start; the wall joins them.
    (line,) = lines
    assert line[:, 0].min() == 0.0
    assert line[:, 0].max() == pytest.approx(1.0)
    assert sorted((line[0, 1], line[-1, 1])) == pytest.approx([0.0, 1.0])


def test_a_plane_through_vertices_gives_every_piece_once() -> None:
    line = np.linspace(0.0, 4.0, 5)
    x, z = np.meshgrid(line, line, indexing="ij")
    index = np.arange(25).reshape(5, 5)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    ground = np.column_stack([x.ravel(), 0.1 * x.ravel(), z.ravel()])
    for start, end in (
        ((0.0, 2.0), (4.0, 2.0)),
        ((4.0, 2.0), (0.0, 2.0)),
        ((0.0, 0.0), (4.0, 4.0)),
    ):
        pieces = vertical_cut(ground, faces.astype(np.int32), start, end)
        (whole,) = joined_lines(pieces)
        length = np.hypot(end[0] - start[0], end[1] - start[1])
        assert whole[[0, -1], 0] == pytest.approx([0.0, length])
        assert (pieces[:, 1, 0] - pieces[:, 0, 0]).sum() == pytest.approx(length)


def test_two_meshes_that_share_an_edge_make_one_line() -> None:
    left = np.array([[0, 0, 0], [1, 0.3, 0.1], [0.9, 0.7, 1.1], [0, 0.5, 1]])
    right = np.array([[0.9, 0.7, 1.1], [1, 0.3, 0.1], [2, 0, 0], [2, 0.2, 1]])
    cuts = [
        vertical_cut(left, np.array([[0, 1, 2], [0, 2, 3]], np.int32), (-1.0, 0.47), (3.0, 0.53)),
        vertical_cut(right, np.array([[0, 1, 2], [0, 2, 3]], np.int32), (-1.0, 0.47), (3.0, 0.53)),
    ]
    assert len(joined_lines(np.concatenate(cuts))) == 1


def test_where_three_pieces_meet_a_line_ends() -> None:
    middle = [1.0, 1.0]
    ends = ([0.0, 0.0], [2.0, 0.0], [2.0, 2.0])
    lines = joined_lines(np.array([[middle, end] for end in ends]))
    assert len(lines) == 3


def test_nothing_cut_is_no_line() -> None:
    corners, faces = box()
    assert len(vertical_cut(corners, faces, (-5.0, 3.0), (5.0, 3.0))) == 0
    assert joined_lines(np.zeros((0, 2, 2))) == []
