"""Regions of the base: those of the detail over it, whatever the pieces."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.regions.base_regions import base_regions

Piece = tuple[Float32, Int32, Int32]


def _strip(low: int, high: int, region_of: dict[range, int]) -> Piece:
    """Unit squares along x from low to high, two triangles each; regions by the square's x."""
    squares = np.arange(low, high)
    corners = np.array([[x, 0.0, z] for x in range(low, high + 1) for z in (0, 1)], np.float32)
    at = 2 * (squares - low)
    faces = np.concatenate(
        [np.stack([at, at + 1, at + 2], 1), np.stack([at + 2, at + 1, at + 3], 1)]
    )
    regions = [next(r for span, r in region_of.items() if int(x) in span) for x in squares]
    return corners, faces.astype(np.int32), np.array(regions * 2, np.int32)


def test_a_vertex_has_the_region_of_the_nearest_face() -> None:
    pieces = [_strip(0, 10, {range(5): 7, range(5, 10): 2}), _strip(10, 20, {range(10, 20): 9})]
    base = np.array(
        [[1.5, 0.1, 0.5], [7.5, -0.2, 0.4], [10.4, 0.0, 0.5], [19.0, 0.3, 0.5]], np.float32
    )
    assert_array_equal(base_regions(base, pieces), [7, 2, 9, 9])
    assert_array_equal(base_regions(base, pieces[::-1]), [7, 2, 9, 9])


def test_a_vertex_beyond_all_detail_has_the_nearest_vertexs() -> None:
    base = np.array([[1.0, 0.0, 0.5], [500.0, 0.0, 0.5]], np.float32)
    assert_array_equal(base_regions(base, [_strip(0, 4, {range(4): 3})]), [3, 3])


def test_without_detail_there_are_none() -> None:
    empty = (np.empty((0, 3), np.float32), np.empty((0, 3), np.int32), np.empty(0, np.int32))
    assert base_regions(np.zeros((2, 3), np.float32), [empty]) is None


def test_a_piece_across_the_longest_side_is_found_as_one_along_it() -> None:
    turned = [
        (corners[:, [2, 1, 0]], faces, regions)
        for corners, faces, regions in (
            _strip(0, 10, {range(10): 4}), _strip(10, 20, {range(10, 20): 6}),
        )
    ]  # fmt: skip
    base = np.array([[0.5, 0.1, z] for z in (19.0, 0.5, 10.4, 9.4)], np.float32)
    assert_array_equal(base_regions(base, turned), [6, 4, 6, 4])
