from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.geometry.textures.charts import make_charts

NO_VIEWS = np.zeros((0, 34))


def grid(cells: int, size_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A level square about the origin, its faces seen from above."""
    axis = np.linspace(-size_m / 2, size_m / 2, cells + 1)
    x, z = np.meshgrid(axis, axis, indexing="ij")
    vertices = np.stack([x, 0.1 * np.sin(x) * np.cos(z), -z], axis=2).reshape(-1, 3)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + cells + 1, corner + cells + 2], axis=1),
            np.stack([corner, corner + cells + 2, corner + 1], axis=1),
        ]
    )
    return vertices, faces


def down(height_m: float = 20.0, width: int = 400) -> View:
    """A camera that looks straight down from above the origin; north is up in its photo."""
    lens = Lens(width=width, height=300, fx=200.0, fy=200.0, cx=width / 2, cy=150.0)
    rotation = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return View("a.jpg", lens, rotation, np.array([0.0, height_m, 0.0]))


def test_one_photo_makes_one_chart_of_its_pixels() -> None:
    vertices, faces = grid(8, 10.0)
    view = down()
    charts = make_charts(vertices, faces, np.zeros(len(faces), int), view.packed()[None])
    assert charts.count == 1
    assert (charts.view == 0).all()
    pixels, _ = view.project(vertices)
    np.testing.assert_allclose(charts.pixels, pixels[faces], atol=1e-4)
    np.testing.assert_allclose(charts.uvs, pixels[faces] - pixels.min(axis=0), atol=1e-4)
    np.testing.assert_allclose(charts.sizes[0], np.ptp(pixels, axis=0), atol=1e-4)
    assert np.median(charts.gsd_m) == pytest.approx(20.0 / 200.0, rel=0.02)
    np.testing.assert_allclose(np.sqrt(charts.surface_m2 / charts.texels), charts.gsd_m, rtol=1e-5)


def test_charts_end_where_the_photo_changes() -> None:
    vertices, faces = grid(8, 10.0)
    east = vertices[faces].mean(axis=1)[:, 0] > 0
    packed = np.stack([down().packed(), down(15.0).packed()])
    charts = make_charts(vertices, faces, east.astype(int), packed)
    assert charts.count == 2
    assert set(zip(charts.chart.tolist(), east.tolist(), strict=True)) == {(0, False), (1, True)}


@pytest.mark.parametrize(("texel_m", "expected"), [(0.4, 0.4), (0.01, 0.1)])
def test_texels_are_as_long_as_asked_but_no_shorter_than_pixels(
    texel_m: float, expected: float
) -> None:
    vertices, faces = grid(8, 10.0)
    packed = down().packed()[None]
    charts = make_charts(vertices, faces, np.zeros(len(faces), int), packed, texel_m=texel_m)
    side_m = np.sqrt(charts.surface_m2.sum() / charts.texels.sum())
    assert side_m == pytest.approx(expected, rel=0.02)


def test_faces_that_the_photo_does_not_show_whole_are_without_photo() -> None:
    vertices, faces = grid(8, 100.0)
    charts = make_charts(vertices, faces, np.zeros(len(faces), int), down().packed()[None])
    pixels, _ = down().project(vertices)
    inside = ((pixels >= 0) & (pixels <= [400, 300])).all(axis=1)[faces].all(axis=1)
    assert np.array_equal(charts.view >= 0, inside)
    assert not charts.pixels[~inside].any()
    assert np.isnan(charts.gsd_m[~inside]).all()


def test_a_face_seen_from_behind_lies_on_its_neighbours_texels() -> None:
    """A fold in the noise that took its neighbours' photo shows the same pixels twice."""
    vertices, faces = grid(4, 10.0)
    folded = np.concatenate([faces, faces[5:6, ::-1]])
    charts = make_charts(vertices, folded, np.zeros(len(folded), int), down().packed()[None])
    assert charts.count == 1
    assert (charts.view == 0).all()
    np.testing.assert_array_equal(charts.uvs[-1], charts.uvs[5, ::-1])
    np.testing.assert_array_equal(charts.pixels[-1], charts.pixels[5, ::-1])


def test_without_photo_faces_lie_flat_without_overlap() -> None:
    """A box: six sides, six charts, each with its true shape."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([f for a, b, c, d in quads for f in ([a, b, c], [a, c, d])])
    charts = make_charts(corners, faces, np.full(12, -1), NO_VIEWS, texel_m=0.5)
    assert charts.count == 6
    np.testing.assert_allclose(charts.texels, charts.surface_m2 / 0.25)
    assert sorted(np.round(np.sort(charts.sizes, axis=1), 6).tolist()) == sorted(
        2 * [[2.0, 4.0], [2.0, 6.0], [4.0, 6.0]]
    )
    assert (charts.uvs >= 0).all()


def test_without_a_texel_size_an_edge_has_two_texels() -> None:
    vertices, faces = grid(10, 10.0)
    charts = make_charts(vertices, faces, np.full(len(faces), -1), NO_VIEWS)
    assert np.median(np.sqrt(charts.surface_m2 / charts.texels)) == pytest.approx(0.5, rel=0.25)


def test_beside_photos_a_texel_size_makes_nothing_finer_that_no_photo_shows() -> None:
    """Vertex colours have nothing to show in a texel of a centimetre."""
    vertices, faces = grid(8, 10.0)
    east = vertices[faces].mean(axis=1)[:, 0] > 0
    view, packed = np.where(east, 0, -1), down().packed()[None]
    free = make_charts(vertices, faces, view, packed)
    fine = make_charts(vertices, faces, view, packed, texel_m=0.01)
    coarse = make_charts(vertices, faces, view, packed, texel_m=2.0)
    np.testing.assert_allclose(fine.texels[~east], free.texels[~east])
    np.testing.assert_allclose(coarse.texels[~east].sum(), 50.0 / 2.0**2, rtol=0.05)
    alone = make_charts(vertices, faces, np.full(len(faces), -1), NO_VIEWS, texel_m=0.01)
    assert alone.texels.sum() > 100 * free.texels.sum()


def test_collapsed_faces_do_no_harm() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 0, -1]], dtype=float)
    faces = np.array([[0, 1, 2], [0, 0, 0], [0, 1, 1]])
    charts = make_charts(vertices, faces, np.full(3, -1), NO_VIEWS)
    assert np.isfinite(charts.uvs).all()
    assert np.isfinite(charts.sizes).all()


def test_a_diagonal_road_is_cut_into_pieces_of_little_waste() -> None:
    vertices, faces = grid(64, 12.0)
    centre = vertices[faces].mean(axis=1)
    road = faces[np.abs(centre[:, 0] - centre[:, 2]) < 0.6]
    packed = down(width=400).packed()[None]
    packed[0, 1:3] = 2000.0  # a long lens: the road is 1,700 pixels long
    packed[0, 3:5] = packed[0, 6:8] = 2000.0
    packed[0, 3:5] /= 2.0
    charts = make_charts(vertices, road, np.zeros(len(road), int), packed)
    assert (charts.view == 0).all()
    assert charts.count > 4
    assert charts.texels.sum() > 0.45 * charts.sizes.prod(axis=1).sum()
    first = [int(np.flatnonzero(charts.chart == number)[0]) for number in range(charts.count)]
    assert first == sorted(first)
