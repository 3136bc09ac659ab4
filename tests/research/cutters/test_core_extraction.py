"""Core extraction: feature points, the core between them, and what it cannot cut."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy import sparse

from terraport_pipeline.errors import EngineError
from terraport_research.cutters import Body
from terraport_research.cutters.core_extraction import (
    CORE_EXTRACTION,
    _apart,
    _moved_to_folds,
    _stretched,
)

ARMS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], float)


def star() -> Body:
    """Five arms, three times as long as the ball in the middle is wide."""
    ball = trimesh.creation.icosphere(5)
    direction = np.asarray(ball.vertices)
    near = np.maximum(direction @ ARMS.T, 0.0)
    radius = 1.0 + (5.0 * np.exp(-((1.0 - near) ** 2) / 0.002)).sum(axis=1)
    return Body(direction * radius[:, None], np.asarray(ball.faces, np.int32))


def test_a_star_is_a_core_and_its_arms() -> None:
    body = star()
    labels = CORE_EXTRACTION.prepare(body)(0)
    assert len(np.unique(labels)) == 6
    out = np.sqrt((body.centres**2).sum(axis=1))
    core = labels[np.argmin(out)]
    along = (body.centres @ ARMS.T).argmax(axis=1)
    beyond = out > 2.0  # well up the arms
    assert (labels[beyond] != core).all()
    assert len(set(zip(labels[beyond].tolist(), along[beyond].tolist(), strict=True))) == 5
    np.testing.assert_array_equal(CORE_EXTRACTION.prepare(body)(7), labels)  # told or not


def test_distances_give_places_back() -> None:
    places = np.random.default_rng(3).normal(size=(40, 3))
    away = np.sqrt(((places[:, None] - places) ** 2).sum(axis=2))
    again = _stretched(away)
    np.testing.assert_allclose(
        np.sqrt(((again[:, None] - again) ** 2).sum(axis=2)), away, atol=1e-9
    )


def test_the_core_grows_until_feature_points_are_apart() -> None:
    """A Y: arms 0-1-2-3-6 and 4-5-6 meet at 6, a stem 6-7-8-9; feature points at the three ends."""
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 6], [4, 5], [5, 6], [6, 7], [7, 8], [8, 9]])
    ways = sparse.coo_array((np.ones(9), edges.T), shape=(10, 10))
    ways = (ways + ways.T).tocsr()
    remote = np.array([7, 5, 4, 2, 5, 3, 1, 2, 4, 6], float)
    labels = _apart(ways, remote, np.array([8], np.int32), np.array([0, 4, 9]))
    # 8 is core already, so that 9 is alone; 6 parts the other two, and 7 then holds none.
    assert labels.tolist() == [1, 1, 1, 1, 2, 2, 0, 0, 0, 3]


def test_borders_move_to_the_fold() -> None:
    """A dumb-bell cut a little above its waist is cut at it."""
    length, around = 60, 24
    z, turn = np.meshgrid(np.arange(length + 1) / 15, np.arange(around) * 2 * np.pi / around)
    radius = 0.4 + 0.4 * np.abs(z - 2.0)
    vertices = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=-1)
    i, j = np.meshgrid(np.arange(around), np.arange(length), indexing="ij")
    a, b = i * (length + 1) + j, (i + 1) % around * (length + 1) + j
    faces = np.stack([a, b, a + 1, a + 1, b, b + 1], axis=-1).reshape(-1, 3).astype(np.int32)
    tube = Body(vertices.reshape(-1, 3), faces)
    above = (tube.centres[:, 2] > 2.0).astype(np.int32)
    cut_above = (tube.centres[:, 2] > 2.15).astype(np.int32)
    assert (cut_above != above).sum() > 40
    np.testing.assert_array_equal(_moved_to_folds(tube, cut_above), above)


def test_what_it_cannot_cut() -> None:
    ball = trimesh.creation.icosphere(3)
    two = trimesh.util.concatenate([ball, ball.copy().apply_translation((5, 0, 0))])
    with pytest.raises(EngineError, match="2 pieces; core extraction needs one"):
        CORE_EXTRACTION.prepare(Body(np.asarray(two.vertices), np.asarray(two.faces, np.int32)))
    # A cone: its tip alone is far from everything.
    cone = trimesh.creation.cone(1.0, 1.0, sections=48).subdivide().subdivide()
    with pytest.raises(EngineError, match="no two feature points"):
        CORE_EXTRACTION.prepare(Body(np.asarray(cone.vertices), np.asarray(cone.faces, np.int32)))
