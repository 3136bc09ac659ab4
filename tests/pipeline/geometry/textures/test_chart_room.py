"""Any mesh has an image: what has no room gets flat colours."""

from __future__ import annotations

import numpy as np
import pytest
from photo_scene import ground, look_at

from terraport_pipeline.geometry.textures.chart_room import (
    MOST_FLAT,
    charts_with_room,
    flat_colours,
)

NO_VIEWS = np.zeros((0, 30))


def loose_triangles(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles that touch nothing, larger and larger."""
    origin = np.arange(count)[:, None, None] * np.array([4.0, 0.0, 0.0])
    corner = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    size = np.linspace(0.5, 1.5, count)[:, None, None]
    points = (origin + corner * size).reshape(-1, 3)
    return points, np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def test_the_smallest_charts_are_given_up() -> None:
    points, corners = loose_triangles(300)
    fitted = charts_with_room(
        points, corners, np.full(300, -1, np.int32), NO_VIEWS, texel_m=None, max_side=256
    )
    assert fitted.charts is not None
    assert fitted.charts.count == 64  # a quarter of 16 x 16 cells
    assert fitted.rows.tolist() == list(range(236, 300))
    assert np.flatnonzero(fitted.crowded).tolist() == list(range(236))


def test_faces_without_area_are_in_no_chart() -> None:
    points, corners = loose_triangles(4)
    points[corners[1]] = points[corners[1][0]]  # one point
    points[corners[2][1]] = 0.5 * (points[corners[2][0]] + points[corners[2][2]])  # a line
    fitted = charts_with_room(
        points, corners, np.full(4, -1, np.int32), NO_VIEWS, texel_m=None, max_side=256
    )
    assert fitted.rows.tolist() == [0, 3]
    assert not fitted.crowded.any()


def test_a_mesh_without_area_has_no_chart() -> None:
    fitted = charts_with_room(
        np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32), np.array([-1], np.int32), NO_VIEWS,
        texel_m=None, max_side=256,
    )  # fmt: skip
    assert fitted.charts is None
    assert not len(fitted.rows)


@pytest.mark.parametrize("count", [0, 1, 5, 20_000])
def test_few_colours_stand_for_many(count: int) -> None:
    colours = np.random.default_rng(4).integers(0, 256, (count, 3)).astype(np.uint8)
    flat = flat_colours(colours)
    assert len(flat.colours) <= MOST_FLAT
    assert len(flat.of_face) == count
    difference = flat.colours[flat.of_face].astype(int) - colours
    assert np.abs(difference).max(initial=0) < (64 if count > MOST_FLAT else 8)


def test_beside_photos_specks_without_one_are_flat() -> None:
    """A photo shows the first half of a strip; the rest: a face, fifty faces, and a large piece."""
    vertices, faces = ground(40)
    middle = vertices[faces].mean(axis=1)
    seen = middle[:, 0] < 10.0
    speck = np.flatnonzero((np.abs(middle - [30.0, 0.0, 30.0]) < [0.3, 9.0, 0.3]).all(axis=1))[:1]
    piece = (middle[:, 0] > 33.0) & (middle[:, 2] < 8.0)
    few = np.flatnonzero((np.abs(middle - [25.0, 0.0, 20.0]) < [2.5, 9.0, 2.5]).all(axis=1))
    assert 32 < len(few) < 64
    speck = np.union1d(speck, few)
    rows = np.flatnonzero(seen | piece | np.isin(np.arange(len(faces)), speck))
    view = np.where(seen, 0, -1)[rows].astype(np.int32)
    camera = look_at("a.jpg", (15.0, 60.0, 20.0), (15.0, 0.0, 20.1)).packed()[None]
    fitted = charts_with_room(
        vertices.astype(float), faces[rows], view, camera, texel_m=None, max_side=512
    )
    left = np.setdiff1d(np.arange(len(rows)), fitted.rows)
    assert rows[left].tolist() == speck.tolist()
    assert not fitted.crowded.any()
