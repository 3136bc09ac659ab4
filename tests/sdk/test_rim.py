"""How far the rim of the base sinks: a slope, a wall, other storeys, nothing to compare with."""

from __future__ import annotations

import numpy as np
import pytest

from terraport import mesh as rim
from terraport.mesh import rim_heights

SQUARE = np.float32([[0, 0, 0], [0, 0, 4], [4, 0, 4], [4, 0, 0]])
FACES = np.int32([[0, 1, 2], [0, 2, 3]])


def test_each_face_sinks_by_what_lies_furthest_below_it() -> None:
    points = np.float32([[1, -0.2, 3], [1, -0.5, 3.1], [3, -0.1, 1], [3, 0.4, 1]])
    heights_m = rim_heights(SQUARE, FACES, points, most_m=1.0)
    # The corners that the two faces share take the larger.
    np.testing.assert_allclose(heights_m, [0.5, 0.5, 0.5, 0.1], atol=1e-6)


def test_heights_are_along_the_normal_of_a_slope_and_of_a_wall() -> None:
    slope = SQUARE + SQUARE[:, [1, 0, 1]]  # 45 degrees: y = x
    heights_m = rim_heights(slope, FACES, np.float32([[2, 1.8, 2]]), most_m=1.0)
    np.testing.assert_allclose(heights_m, np.full(4, 0.2 / np.sqrt(2)), atol=1e-6)
    wall = SQUARE[:, [1, 0, 2]] * np.float32([1, 1, -1])
    heights_m = rim_heights(wall, FACES, np.float32([[0.3, 2, -2], [-0.3, 2, -2]]), most_m=1.0)
    np.testing.assert_allclose(heights_m, np.full(4, 0.3), atol=1e-6)


def test_other_storeys_and_places_beside_count_nothing() -> None:
    points = np.float32([[2, -9, 2], [9, -0.5, 9], [-0.9, -0.5, 2]])
    assert not rim_heights(SQUARE, FACES, points, most_m=1.0).any()


@pytest.mark.parametrize(("faces", "points", "most_m"), [(0, 1, 1.0), (2, 0, 1.0), (2, 1, 0.0)])
def test_nothing_in_nothing_out(faces, points, most_m) -> None:
    heights_m = rim_heights(SQUARE, FACES[:faces], np.zeros((points, 3), np.float32), most_m=most_m)
    np.testing.assert_array_equal(heights_m, np.zeros(4, np.float32))


def test_portions_and_order_do_not_matter(monkeypatch) -> None:
    rng = np.random.default_rng(3)
    line = np.arange(12)
    x, z = np.meshgrid(line, line, indexing="ij")
    vertices = np.stack([x, rng.random(x.shape), z], axis=-1).reshape(-1, 3).astype(np.float32)
    at = np.arange(144).reshape(12, 12)
    quad = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    points = rng.uniform([0, -1, 0], [11, 1, 11], (3000, 3)).astype(np.float32)
    whole = rim_heights(vertices, faces, points, most_m=2.0)
    monkeypatch.setattr(rim, "_MAX_PAIRS", 500)
    np.testing.assert_array_equal(rim_heights(vertices, faces, points[::-1], most_m=2.0), whole)
    assert whole.max() > 1.0
