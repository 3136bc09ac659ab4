"""Lenses against pycolmap's own cameras, and there and back."""

from __future__ import annotations

import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_pipeline.geometry.photos.lens import (
    PACKED,
    Lens,
    View,
    project_packed,
    ray_packed,
    valid_radius,
)

# model, COLMAP's parameters, our lens; all of 2000 x 1500 pixels
BROWN = (1500.0, 1490.0, 1010.0, 740.0)
FISHEYE = (700.0, 705.0, 1003.0, 752.0)
CASES = {
    "SIMPLE_PINHOLE": ((1500.0, 1010.0, 740.0), Lens(2000, 1500, 1500, 1500, 1010, 740)),
    "PINHOLE": (BROWN, Lens(2000, 1500, *BROWN)),
    "SIMPLE_RADIAL": (
        (1500.0, 1010.0, 740.0, -0.05),
        Lens(2000, 1500, 1500, 1500, 1010, 740, radial=(-0.05,)),
    ),
    "RADIAL": (
        (1500.0, 1010.0, 740.0, -0.2, 0.04),
        Lens(2000, 1500, 1500, 1500, 1010, 740, radial=(-0.2, 0.04)),
    ),
    "OPENCV": (
        (*BROWN, -0.2, 0.05, 0.001, -0.002),
        Lens(2000, 1500, *BROWN, radial=(-0.2, 0.05), tangential=(0.001, -0.002)),
    ),
    "FULL_OPENCV": (
        (*BROWN, -0.2, 0.05, 0.001, -0.002, 0.01, 0.1, 0.02, 0.001),
        Lens(
            2000,
            1500,
            *BROWN,
            radial=(-0.2, 0.05, 0.01),
            tangential=(0.001, -0.002),
            denominator=(0.1, 0.02, 0.001),
        ),
    ),
    "OPENCV_FISHEYE": (
        (*FISHEYE, 0.05, -0.02, 0.003, -0.001),
        Lens(2000, 1500, *FISHEYE, model="fisheye", radial=(0.05, -0.02, 0.003, -0.001)),
    ),
    "SIMPLE_RADIAL_FISHEYE": (
        (700.0, 1003.0, 752.0, 0.03),
        Lens(2000, 1500, 700, 700, 1003, 752, model="fisheye", radial=(0.03,)),
    ),
    "RADIAL_FISHEYE": (
        (700.0, 1003.0, 752.0, 0.03, -0.01),
        Lens(2000, 1500, 700, 700, 1003, 752, model="fisheye", radial=(0.03, -0.01)),
    ),
}


@pytest.fixture(params=CASES)
def both(request):
    params, lens = CASES[request.param]
    theirs = pycolmap.Camera(model=request.param, width=2000, height=1500, params=params)
    return theirs, lens


def points_before(lens):
    """Points all over the picture and a little beyond."""
    rng = np.random.default_rng(4)
    spread = 1.5 if lens.model == "fisheye" else 0.7
    flat = rng.uniform(-spread, spread, (2000, 2)) * (1.0, 0.75)
    return np.column_stack([flat, np.ones(2000)]) * rng.uniform(0.5, 90.0, (2000, 1))


def test_project_agrees_with_colmap(both):
    theirs, lens = both
    points = points_before(lens)
    expected = theirs.img_from_cam(points)
    pixels = lens.project(points)
    assert not np.isnan(pixels).any()
    assert np.abs(pixels - expected).max() < 1e-6


def test_unproject_inverts_project_in_the_whole_picture(both):
    _, lens = both
    pixels = np.stack(
        np.meshgrid(np.linspace(0, 2000, 41), np.linspace(0, 1500, 31)), axis=-1
    ).reshape(-1, 2)
    if (
        lens.model == "fisheye"
    ):  # its corners look back over the shoulder, which no lens of ours does
        pixels = pixels[np.linalg.norm(pixels - (lens.cx, lens.cy), axis=1) < 1000.0]
    rays = lens.unproject(pixels)
    assert np.abs(np.linalg.norm(rays, axis=1) - 1.0).max() < 1e-12
    assert np.abs(lens.project(rays * 37.0) - pixels).max() < 1e-8


def test_a_point_behind_the_camera_is_in_no_photo(both):
    _, lens = both
    behind = np.array([[0.1, 0.1, -1.0], [0.3, 0.0, 0.0], [np.nan, 0.0, 1.0]])
    assert np.isnan(lens.project(behind)).all()


def test_beyond_the_fold_nothing_is_projected():
    # r (1 - 0.3 r^2) is greatest at r = sqrt(1 / 0.9): beyond, the picture would be entered again
    lens = Lens(1000, 1000, 500, 500, 500, 500, radial=(-0.3,))
    fold = np.sqrt(1.0 / 0.9)
    assert valid_radius(lens) == pytest.approx(fold, rel=1e-12)
    tangents = np.array([0.99, 1.01, 1.7]) * fold
    pixels = lens.project(np.column_stack([tangents, 0.0 * tangents, 1.0 + 0.0 * tangents]))
    assert np.isfinite(pixels[0]).all()
    assert np.isnan(pixels[1:]).all()
    # and the pixel further out than the fold's has no ray
    edge = 500.0 + 500.0 * fold * (1 - 0.3 * fold**2)
    rays = lens.unproject(np.array([[edge - 0.5, 500.0], [edge + 0.5, 500.0]]))
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1]).all()


def test_a_denominator_that_vanishes_bounds_the_lens():
    lens = Lens(1000, 1000, 500, 500, 500, 500, denominator=(-1.0,))
    assert valid_radius(lens) == pytest.approx(1.0)


def test_tangential_terms_fold_too():
    plain = Lens(1000, 1000, 500, 500, 500, 500, radial=(-0.3,))
    leaning = Lens(1000, 1000, 500, 500, 500, 500, radial=(-0.3,), tangential=(0.02, 0.0))
    assert 0.85 * valid_radius(plain) < valid_radius(leaning) < valid_radius(plain)
    radius = 0.999999 * valid_radius(leaning)
    turn = np.linspace(0, 2 * np.pi, 721)
    ring = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.ones(721)])
    back = leaning.unproject(leaning.project(ring))
    assert np.abs(back - ring / np.linalg.norm(ring, axis=1)[:, None]).max() < 1e-6


def test_a_lens_scales_with_its_photo():
    lens = CASES["OPENCV"][1]
    points = points_before(lens)
    half = lens.scaled(1000, 750)
    assert np.abs(half.project(points) - 0.5 * lens.project(points)).max() < 1e-9


def test_skew_moves_columns_by_row():
    lens = Lens(100, 100, 50, 50, 50, 50, skew=5.0)
    assert lens.project(np.array([[0.0, 1.0, 1.0]])).tolist() == [[55.0, 100.0]]
    assert lens.unproject(np.array([[55.0, 100.0]]))[0] == pytest.approx(
        np.array([0.0, 1.0, 1.0]) / np.sqrt(2)
    )


small = st.floats(-0.1, 0.1)


@settings(max_examples=60)
@given(
    st.lists(small, max_size=6).map(tuple),
    st.tuples(small, small).map(lambda p: (0.05 * p[0], 0.05 * p[1])),
    st.lists(small, max_size=3).map(tuple),
    st.sampled_from(["radial", "fisheye"]),
    st.floats(-20, 20),
    st.integers(0, 10**6),
)
def test_there_and_back(radial, tangential, denominator, model, skew, seed):
    lens = Lens(2000, 1500, 900, 910, 990, 760, model, radial, tangential, skew, denominator)
    rng = np.random.default_rng(seed)
    limit = 0.98 * valid_radius(lens)
    away = np.sqrt(rng.uniform(0, 1, 50)) * (
        limit if model == "fisheye" else min(limit, np.tan(1.3))
    )
    turn = rng.uniform(0, 2 * np.pi, 50)
    angle = away if model == "fisheye" else np.arctan(away)
    rays = np.column_stack(
        [np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)]
    )
    pixels = lens.project(rays)
    assert np.isfinite(pixels).all()
    assert np.abs(lens.unproject(pixels) - rays).max() < 1e-7


def a_view():
    turn, _ = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    return View("a.jpg", CASES["OPENCV"][1], turn, np.array([10.0, 60.0, -5.0]))


def test_a_view_projects_as_its_lens_does():
    view = a_view()
    points = points_before(view.lens) @ view.rotation + view.position
    pixels, depth_m = view.project(points)
    camera = (points - view.position) @ view.rotation.T
    assert np.abs(pixels - view.lens.project(camera)).max() < 1e-9
    assert np.abs(depth_m - camera[:, 2]).max() < 1e-9
    rays = view.rays(pixels)
    ahead = points - view.position
    assert np.abs(rays - ahead / np.linalg.norm(ahead, axis=1)[:, None]).max() < 1e-12


def test_kernels_give_the_same():
    view = a_view()
    row = view.packed()
    assert row.shape == (PACKED,)
    point = view.position + np.array([0.1, -0.2, 1.0]) @ view.rotation * 20
    u, v, depth_m = project_packed(row, *point)
    pixels, depths = view.project(point[None])
    assert [u, v, depth_m] == [*pixels[0], depths[0]]
    assert np.array(ray_packed(row, u, v)) == pytest.approx(view.rays(pixels)[0])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"fx": np.nan}, "finite"),
        ({"fy": 0.0}, "above 0"),
        ({"width": 0}, "no pixels"),
        ({"radial": (0.0,) * 7}, "at most 6 radial"),
        ({"denominator": (0.0,) * 4}, "at most 3 denominator"),
        ({"model": "mirror"}, "'mirror'"),
        ({"tangential": (0.0,)}, "two tangential"),
    ],
)
def test_what_is_no_lens_is_refused(changed, message):
    fields = {"width": 100, "height": 80, "fx": 50.0, "fy": 50.0, "cx": 50.0, "cy": 40.0}
    with pytest.raises(ValueError, match=message):
        Lens(**{**fields, **changed})


@pytest.mark.parametrize(
    ("rotation", "position", "message"),
    [
        (np.eye(3) * 1.1, np.zeros(3), "without mirroring"),
        (np.diag([1.0, 1.0, -1.0]), np.zeros(3), "without mirroring"),
        (np.full((3, 3), np.nan), np.zeros(3), "without mirroring"),
        (np.eye(3), np.array([0.0, np.inf, 0.0]), "finite position"),
        (np.eye(4), np.zeros(3), r"\(3, 3\)"),
    ],
)
def test_what_is_no_view_is_refused(rotation, position, message):
    lens = CASES["PINHOLE"][1]
    with pytest.raises(ValueError, match=message):
        View("a.jpg", lens, rotation, position)
