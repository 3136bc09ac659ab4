from __future__ import annotations

import numpy as np

from terraport_pipeline.synth.camera_eye import CameraEye
from terraport_pipeline.synth.flight import plan_flight
from terraport_pipeline.synth.options import FlightOptions
from terraport_pipeline.synth.truck import Truck, parking_places, place_truck

FORWARD_NORTH = Truck(np.array([10.0, 5.0, -20.0]), np.pi / 2, 1.0)


def test_a_ray_from_above_meets_the_tray_and_the_cab() -> None:
    # Heading north: the cab lies towards -z.
    starts = np.array([[10.0, 20.0, -19.0], [10.0, 20.0, -23.5], [10.0, 20.0, -30.0]])
    t, colours, normals = FORWARD_NORTH.intersect(starts, np.tile([0.0, -1.0, 0.0], (3, 1)))
    np.testing.assert_allclose(t, [15 - 3.4, 15 - 4.0, np.inf])
    np.testing.assert_allclose(normals[:2], [[0, 1, 0], [0, 1, 0]], atol=1e-12)
    assert colours[0].tolist() == [236, 172, 36]
    assert colours[1].tolist() == [244, 226, 206]


def test_a_ray_from_the_side_meets_the_nearest_box() -> None:
    start = np.array([[30.0, 5.6, -20.0]])
    t, colours, normals = FORWARD_NORTH.intersect(start, np.array([[-1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(t, [20.0 - 1.5])
    np.testing.assert_allclose(normals, [[1, 0, 0]], atol=1e-12)
    assert colours[0].max() < 60  # the running gear


def test_corners_enclose_the_truck() -> None:
    corners = FORWARD_NORTH.corners() - FORWARD_NORTH.position
    np.testing.assert_allclose(corners.min(axis=0), [-1.9, 0.0, -4.6])
    np.testing.assert_allclose(corners.max(axis=0), [1.9, 4.0, 4.8])


def test_it_parks_on_level_ground_in_the_picture(eye: CameraEye) -> None:
    options = eye.options
    places = parking_places(eye.surface, options.seed, options.scale)
    assert len(places) > 30
    view = plan_flight(FlightOptions(count=6, width=400, height=300), options).views[2]
    trucks = place_truck(view, 2, places, options.seed, options.scale)
    assert 1 <= len(trucks) <= 8
    pixels, _ = view.project(np.stack([truck.position for truck in trucks]))
    assert (pixels > [48, 36]).all()
    assert (pixels < [352, 264]).all()
    other = place_truck(view, 3, places, options.seed, options.scale)
    assert not np.array_equal(trucks[0].position, other[0].position)
