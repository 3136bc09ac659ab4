"""Parts of the labelling, each against what can be written down."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.photos.label_kernels import (
    best_slots,
    common_slots,
    costs,
    neighbour_rows,
    solve_piece,
)
from terraport_pipeline.geometry.photos.view_kernels import QUALITY_STEPS, SLOTS


def places(*rows: list[int]) -> np.ndarray:
    """Views of each face, the places behind them empty."""
    views = np.full((len(rows), SLOTS), -1, np.int16)
    for row, listed in zip(views, rows, strict=True):
        row[: len(listed)] = listed
    return views


def test_neighbours_know_of_each_other_and_how_long_their_edge_is() -> None:
    vertices = np.array([[0, 0, 0], [4, 0, 0], [0, 0, 3], [4, 0, 3], [8, 0, 3]], np.float32)
    faces = np.array([[0, 2, 1], [1, 2, 3], [1, 3, 4]], np.int32)
    pairs, edges = face_pairs(faces, len(vertices))
    rows, length, area = neighbour_rows(vertices, faces, pairs, edges)
    assert [sorted(row[row >= 0].tolist()) for row in rows] == [[1], [0, 2], [1]]
    assert (length[rows < 0] == 0).all()
    for f, g in ((0, 1), (1, 2)):
        assert length[f][rows[f] == g] == length[g][rows[g] == f]
    # diagonal 5, upright 3; in means of the edges that two faces share
    assert sorted(length[rows >= 0]) == pytest.approx([0.75, 0.75, 1.25, 1.25])
    assert area.tolist() == pytest.approx([1, 1, 1])


def test_three_faces_on_one_edge_leave_no_half_neighbour() -> None:
    fan = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5]], np.int32)
    every = np.array([[f, g] for f in range(4) for g in range(f + 1, 4)], np.int32)
    vertices = np.random.default_rng(0).random((6, 3)).astype(np.float32)
    ends = np.tile(np.array([[0, 1]], np.int32), (len(every), 1))
    rows, _, _ = neighbour_rows(vertices, fan, every, ends)
    for f, row in enumerate(rows.tolist()):
        for g in row:
            assert g < 0 or f in rows[g]


def test_half_the_quality_costs_half() -> None:
    views = places([0, 3, 5])
    values = np.zeros((1, SLOTS), np.uint16)
    values[0, :3] = 9000, 9000 - QUALITY_STEPS, 9000 - 2 * QUALITY_STEPS
    costs(views, values, 0, 1)
    assert values[0, :3].tolist() == [0, 32768, 49151]
    assert (values[0, 3:] == 65535).all()


def test_the_cheapest_place_and_of_equal_ones_the_first() -> None:
    views = places([2, 4, 6], [], [1, 3])
    values = np.full((3, SLOTS), 65535, np.uint16)
    values[0, :3] = 7, 5, 5
    slot = np.full(3, 9, np.int8)
    best_slots(views, values, slot, 0, 3)
    assert slot.tolist() == [1, -1, 0]


def test_a_cell_takes_the_view_that_most_of_its_ground_likes() -> None:
    # view 8 is the best of the large face, and the second best of the others
    views = places([5, 8], [5, 8], [6, 8], [7], [5])
    values = np.full((5, SLOTS), 65535, np.uint16)
    values[:, 0] = 0
    values[:3, 1] = 6553
    area = np.array([1, 1, 1, 1, 50], np.float32)
    slot = np.zeros(5, np.int8)
    starts, order = np.array([0, 4, 5], np.int64), np.arange(5, dtype=np.int32)
    common_slots(views, values, area, order, starts, slot, 0, 2)
    assert slot.tolist() == [1, 1, 1, 0, 0]  # who lacks the cell's view keeps its own


def strip(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Neighbours, edge lengths and areas of a strip of faces."""
    neighbour = np.full((n, 3), -1, np.int32)
    neighbour[1:, 0] = np.arange(n - 1)
    neighbour[:-1, 1] = np.arange(1, n)
    return neighbour, (neighbour >= 0).astype(np.float32), np.ones(n, np.float32)


@pytest.mark.parametrize(("smoothness", "expected"), [(0.1, [1, 0, 0, 1]), (0.4, [1, 1, 1, 1])])
def test_a_seam_is_worth_so_much_cost(smoothness: float, expected: list[int]) -> None:
    views = places(*[[0, 1]] * 4)
    values = np.zeros((4, SLOTS), np.uint16)
    values[[0, 3], 0] = 65535  # the outer two want view 1, the inner two view 0, for 0.2 each
    values[1:3, 1] = 13107
    old, slot = np.zeros(4, np.int8), np.zeros(4, np.int8)
    solve_piece(views, values, *strip(4), old, slot, smoothness, 0, 0, 4)
    assert slot.tolist() == expected


def test_faces_that_touch_another_piece_rest() -> None:
    views = places(*[[0, 1]] * 4)
    values = np.zeros((4, SLOTS), np.uint16)
    values[:, 0] = 65535
    old, slot = np.zeros(4, np.int8), np.zeros(4, np.int8)
    solve_piece(views, values, *strip(4), old, slot, 0.0, 0, 1, 4)
    assert slot.tolist() == [0, 0, 1, 1]
