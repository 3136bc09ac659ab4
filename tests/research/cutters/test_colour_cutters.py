"""Algorithms that compare colours: a strip of squares whose answer is written out."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.errors import SurveyError
from terraport_research.cutters import COLOUR_CUTTERS, Body
from terraport_research.cutters.colour_growing import join_similar


def strip(levels: list[int], heights: list[float] | None = None, wide: int = 6) -> Body:
    """Squares in rows: one grey level each row, and rising where heights are given."""
    rows = len(levels)
    up = np.zeros(2 * rows) if heights is None else np.repeat(heights, 2)
    # Two lines of vertices each row, so that colours do not mix; rows 1 apart, touching in space.
    y = np.concatenate([[row, row + 1.0] for row in range(rows)])
    x, line = np.meshgrid(np.arange(wide + 1.0), np.arange(2 * rows))
    vertices = np.stack([x, y[line], up[line]], axis=-1).reshape(-1, 3)
    grey = np.repeat(np.repeat(np.array(levels, np.uint8), 2), wide + 1)
    i, row = np.meshgrid(np.arange(wide), np.arange(rows))
    a = (2 * row * (wide + 1) + i).ravel()
    b = a + wide + 1
    faces = np.stack([a, a + 1, b, b, a + 1, b + 1], axis=-1).reshape(-1, 3).astype(np.int32)
    return Body(vertices, faces, colours=np.repeat(grey[:, None], 3, axis=1))


def rows_of(labels: np.ndarray, rows: int) -> list[int]:
    """One label a row: every face of the row has it."""
    by_row = labels.reshape(rows, -1)
    assert (by_row == by_row[:, :1]).all()
    return by_row[:, 0].tolist()


def test_regions_grow_over_small_steps_and_stop_at_large_ones() -> None:
    body = strip([100, 102, 104, 140, 142, 144])
    labels = COLOUR_CUTTERS["colour-growing"].prepare(body)(0)
    assert rows_of(labels, 6) == [0, 0, 0, 1, 1, 1]


def test_a_double_threshold_needs_both() -> None:
    cut = COLOUR_CUTTERS["double-threshold"].prepare
    assert rows_of(cut(strip([100] * 4))(0), 4) == [0] * 4
    assert rows_of(cut(strip([100, 100, 140, 140]))(0), 4) == [0, 0, 1, 1]
    # Alike in colour, but the last two rows stand upright.
    flat = strip([100] * 4)
    vertices = flat.vertices.copy()
    beyond = vertices[:, 1] > 2.0
    upright = np.stack([vertices[:, 0], np.full(len(vertices), 2.0), vertices[:, 1] - 2.0], axis=1)
    folded = Body(np.where(beyond[:, None], upright, vertices), flat.faces, colours=flat.colours)
    assert rows_of(cut(folded)(0), 4) == [0, 0, 1, 1]


def test_small_regions_join_their_like() -> None:
    """Five regions in a row, one face each but the two ends; colours 0, 10, 90, 12, 100."""
    labels = np.array([0, 0, 0, 1, 2, 3, 4, 4, 4], np.int32)
    colours = np.repeat(np.array([[0, 0, 0, 10, 90, 12, 100, 100, 100]], float).T, 3, axis=1)
    pairs = np.array([[i, i + 1] for i in range(8)] + [[3, 5], [4, 6]], np.int32)
    # Greys count three times: 10 and 12 are 3.5 apart, 90 and 100 17, 11 and 0 19.
    near = join_similar(labels, colours, pairs, 3, 15.0)
    assert near.tolist() == [0, 0, 0, 1, 2, 1, 3, 3, 3]
    # 1 and 3 are nearest to each other; what they are together joins 0 in the next round.
    assert join_similar(labels, colours, pairs, 3, 20.0).tolist() == [0, 0, 0, 0, 1, 0, 1, 1, 1]


def test_thesis_colour_metric_is_euclidean_in_rgb() -> None:
    """6 levels in one channel are too many; 3 in each of three (5.2 together) are not."""
    cut = COLOUR_CUTTERS["colour-growing"].prepare
    for step, expected in ((3, 1), (4, 2)):
        labels = cut(strip([100, 100, 100 + step, 100 + step]))(0)
        assert labels.max() + 1 == expected


@pytest.mark.parametrize("key", COLOUR_CUTTERS)
def test_nothing_changes_with_the_order_of_faces(key: str) -> None:
    body = strip([100, 101, 120, 119, 160, 158, 20])
    order = np.random.default_rng(1).permutation(len(body.faces))
    labels = COLOUR_CUTTERS[key].prepare(body)(0)
    again = COLOUR_CUTTERS[key].prepare(
        Body(body.vertices, body.faces[order], colours=body.colours)
    )(0)
    pairs = set(zip(labels[order].tolist(), again.tolist(), strict=True))
    assert len(pairs) == len(np.unique(labels)) == len(np.unique(again))


@pytest.mark.parametrize("key", COLOUR_CUTTERS)
def test_a_mesh_without_colour_is_refused(key: str) -> None:
    grey = strip([1, 2])
    with pytest.raises(SurveyError, match="the mesh has no colour"):
        COLOUR_CUTTERS[key].prepare(Body(grey.vertices, grey.faces))
