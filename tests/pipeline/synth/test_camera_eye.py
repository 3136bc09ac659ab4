from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation

from terraport_pipeline.engines.rays import Hits
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.synth.camera_eye import NOTHING, TRUCK, TRUCK_SHADOW, CameraEye
from terraport_pipeline.synth.flight import plan_flight
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import FlightOptions
from terraport_pipeline.synth.truck import parking_places, place_truck


def view_of(eye: CameraEye, number: int = 0) -> View:
    options = FlightOptions(count=8, width=200, height=150)
    return plan_flight(options, eye.options).views[number]


def test_a_pixel_shows_the_ground_its_ray_meets(eye: CameraEye) -> None:
    view = view_of(eye, 1)
    seen = eye.look(view)
    assert seen.colours.shape == (150, 200, 3)
    row, column = np.array([40, 75, 120]), np.array([60, 100, 150])
    rays = view.rays(np.stack([column + 0.5, row + 0.5], axis=1))
    places = view.position + rays * seen.distance_m[row, column][:, None]
    pixels, _ = view.project(places)
    np.testing.assert_allclose(pixels, np.stack([column + 0.5, row + 0.5], axis=1), atol=0.02)
    scale = eye.options.scale
    exact = eye.surface.terrain.positions(places[:, 0] / scale, -places[:, 2] / scale)
    # The quarry's ground over the same place, within the mesh's sag and the warp of the highwall.
    assert np.median(np.abs(exact[:, 2] * scale - places[:, 1])) < 0.1


def test_the_same_view_gives_the_same_bytes_on_one_thread(eye: CameraEye) -> None:
    first = CameraEye(eye.options, 1.2, threads=1).look(view_of(eye))
    second = eye.look(view_of(eye))
    np.testing.assert_array_equal(first.colours, second.colours)
    np.testing.assert_array_equal(first.what, second.what)


def test_two_views_agree_about_a_place(eye: CameraEye) -> None:
    """The colours belong to the ground, not to the picture."""
    a, b = view_of(eye, 1), view_of(eye, 2)
    seen_a, seen_b = eye.look(a), eye.look(b)
    row, column = (grid.ravel() for grid in np.mgrid[10:140:3, 10:190:3])
    rays = a.rays(np.stack([column + 0.5, row + 0.5], axis=1))
    places = a.position + rays * seen_a.distance_m[row, column][:, None]
    pixels, _ = b.project(places)
    ok = np.isfinite(pixels).all(axis=1) & (pixels > 1).all(axis=1)
    ok &= (pixels < [199, 149]).all(axis=1)
    x, y = np.floor(pixels[ok]).astype(int).T
    near = np.abs(np.linalg.norm(places[ok] - b.position, axis=1) - seen_b.distance_m[y, x]) < 0.3
    difference = np.abs(seen_a.colours[row[ok], column[ok]] - seen_b.colours[y, x]).mean(axis=1)
    assert near.sum() > 300
    assert np.median(difference[near]) < 12


def test_a_truck_and_its_shadow_stand_in_the_picture_only(eye: CameraEye) -> None:
    view = view_of(eye, 1)
    places = parking_places(eye.surface, 7, eye.options.scale)
    truck = place_truck(view, 1, places, 7, eye.options.scale)[0]
    without, seen = eye.look(view), eye.look(view, truck)
    assert not np.isin(without.what, (TRUCK, TRUCK_SHADOW)).any()
    assert (seen.what == TRUCK).sum() > 10
    assert (seen.what == TRUCK_SHADOW).sum() > 3
    shadow = seen.what == TRUCK_SHADOW
    assert (seen.colours[shadow].mean(axis=0) < 0.85 * without.colours[shadow].mean(axis=0)).all()
    near = binary_dilation(np.isin(seen.what, (TRUCK, TRUCK_SHADOW)), iterations=2)
    changed = np.abs(seen.colours - without.colours).max(axis=2) > 0.01
    assert not (changed & ~near).any()  # beside them only the rays of the outline


def test_materials_and_nothing_are_told_apart(eye: CameraEye) -> None:
    seen = [eye.look(view_of(eye, number)).what for number in (0, 6)]
    seen_materials = set(np.unique(np.concatenate([pixels.ravel() for pixels in seen])).tolist())
    assert {Material.GRASSLAND, Material.BENCH, Material.ROCK_FACE, NOTHING} <= seen_materials


def test_colours_at_hits_are_those_of_the_surface(eye: CameraEye) -> None:
    start = np.array([[5.0, 60.0, 8.0], [-20.0, 60.0, 20.0]])
    hits = eye.rays.intersect(start, np.tile([0.0, -1.0, 0.0], (2, 1)))
    colours = eye.colours_at(Hits(hits.t, hits.face, hits.u, hits.v), 0.05)
    assert colours.shape == (2, 3)
    assert (colours > 5).all()
    assert (colours < 250).all()


def test_single_pixels_see_what_the_picture_shows(eye: CameraEye) -> None:
    view = view_of(eye, 1)
    seen = eye.look(view)
    row, column = np.array([50, 90]), np.array([70, 120])
    colours = eye.colours_along(view, np.stack([column + 0.5, row + 0.5], axis=1))
    # The picture's outlines have four rays more.
    assert np.abs(colours - seen.colours[row, column]).max() < 40
    assert colours.shape == (2, 3)
