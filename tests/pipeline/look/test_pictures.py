"""Pictures: the right thing in the right pixel, light from above, round trips of the encoders."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from terraport_pipeline.engines.cameras import eye_level, oblique, top_down
from terraport_pipeline.engines.pictures import (
    HORIZON,
    encode_jpeg,
    encode_png,
    render_mesh,
    render_points,
    save_png,
)
from terraport_pipeline.engines.rays import RayScene

# A 4 m x 2 m plate, west half red, east half blue (two quads that share an edge in the middle).
PLATE = np.array(
    [[0, 0, 0], [0, 0, 2], [2, 0, 0], [2, 0, 2], [4, 0, 0], [4, 0, 2]], dtype=np.float32
)
PLATE_FACES = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]], dtype=np.int32)
RED, BLUE = (200, 20, 20), (20, 20, 200)
PLATE_COLOURS = np.array([RED, RED, BLUE, BLUE], dtype=np.uint8)


def test_each_face_is_drawn_where_it_lies() -> None:
    camera = top_down(PLATE, aspect=2.0, margin=0.25)
    image = render_mesh(
        PLATE, PLATE_FACES, camera, (60, 30), face_colours=PLATE_COLOURS, relief=0.0
    )
    assert image.shape == (30, 60, 3)
    assert image.dtype == np.uint8
    assert tuple(image[15, 20]) == RED
    assert tuple(image[15, 40]) == BLUE
    np.testing.assert_array_equal(image[0, 0], HORIZON)


def test_vertex_colours_are_interpolated() -> None:
    colours = np.zeros((6, 3), np.uint8)
    colours[4:] = 200
    camera = top_down(PLATE, aspect=2.0, margin=0.0)
    image = render_mesh(PLATE, PLATE_FACES, camera, (80, 40), colours=colours, relief=0.0)
    assert image[20, 10, 0] == 0
    np.testing.assert_allclose(image[20, 60, 0], 100, atol=5)


def test_ground_is_lighter_than_a_wall_in_shade_and_shadows_fall() -> None:
    ground = np.array([[-9, 0, -9], [-9, 0, 9], [9, 0, 9], [9, 0, -9]], dtype=np.float32)
    # A wall of 4 m along north-south, so that the sun from the north-west shades its east side.
    wall = np.array([[0, 0, -9], [0, 0, 9], [0, 4, 9], [0, 4, -9]], dtype=np.float32)
    vertices = np.concatenate([ground, wall])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], dtype=np.int32)
    camera = top_down(ground, aspect=1.0, margin=0.0)
    lit = render_mesh(vertices, faces, camera, (36, 36), shadows=False)
    shaded = render_mesh(vertices, faces, camera, (36, 36), shadows=True)
    west, east = (18, 8), (18, 20)
    assert lit[west].tolist() == lit[east].tolist() == shaded[west].tolist()
    assert shaded[east].mean() < 0.7 * lit[east].mean()


def test_a_ready_ray_scene_gives_the_same_picture(detail) -> None:
    camera = oblique(detail.vertices, aspect=1.5)
    scene = RayScene(detail.vertices, detail.faces)
    first = render_mesh(detail.vertices, detail.faces, camera, (60, 40), colours=detail.colours)
    second = render_mesh(
        detail.vertices, detail.faces, camera, (60, 40), colours=detail.colours, scene=scene
    )
    np.testing.assert_array_equal(first, second)


def test_supersampling_averages_edges() -> None:
    camera = top_down(PLATE, aspect=2.0, margin=0.1)
    kwargs = {"face_colours": PLATE_COLOURS, "relief": 0.0}
    sharp = render_mesh(PLATE, PLATE_FACES, camera, (31, 15), **kwargs)
    soft = render_mesh(PLATE, PLATE_FACES, camera, (31, 15), supersample=4, **kwargs)
    assert len(np.unique(sharp.reshape(-1, 3), axis=0)) == 3
    assert len(np.unique(soft.reshape(-1, 3), axis=0)) > 3


def test_sky_is_above_the_horizon_and_paler_at_it() -> None:
    camera = eye_level((0, 2, 0), azimuth_deg=0, pitch_deg=0)
    image = render_mesh(PLATE + np.float32([50, -9, 50]), PLATE_FACES, camera, (32, 32)).astype(int)
    assert image[0, 16, 0] < image[14, 16, 0]
    assert image[0, 16, 2] > image[0, 16, 0]


def test_smooth_normals_shade_a_bent_edge_without_a_step(detail) -> None:
    normals = np.tile(np.float32([0, 1, 0]), (len(detail.vertices), 1))
    camera = top_down(detail.vertices, aspect=1.0)
    image = render_mesh(
        detail.vertices, detail.faces, camera, (50, 50), normals=normals, shadows=False
    )
    assert len(np.unique(image[10:40, 10:40].reshape(-1, 3), axis=0)) == 1


def test_nearest_point_wins_and_splats_close_the_gaps() -> None:
    line = np.arange(0.5, 20.5)
    x, z = np.meshgrid(line, line)
    floor = np.stack([x, np.zeros_like(x), z], -1).reshape(-1, 3)
    roof = np.array([[10.5, 5.0, 10.5]])
    points = np.concatenate([roof, floor]).astype(np.float32)
    colours = np.array([RED] + [BLUE] * len(floor), dtype=np.uint8)
    camera = top_down(points, aspect=1.0, margin=0.0)
    image = render_points(points, colours, camera, (60, 60), spacing_m=1.0)
    inner = image[6:-6, 6:-6].reshape(-1, 3)
    assert (inner[:, 0] < 210).all()  # no background shows through
    assert image[33, 33, 0] > image[33, 33, 2]
    assert image[15, 15, 2] > image[15, 15, 0]


def test_points_outside_the_picture_are_left_out() -> None:
    camera = eye_level((0, 0, 0), azimuth_deg=0)
    behind = np.array([[0, 0, 9.0]], dtype=np.float32)
    image = render_points(behind, np.array([RED], np.uint8), camera, (8, 8), spacing_m=1.0)
    assert not (image == RED).all(-1).any()


def test_encoders_round_trip(tmp_path) -> None:
    image = np.random.default_rng(0).integers(0, 255, (9, 7, 3), dtype=np.uint8)
    save_png(image, tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as read:
        np.testing.assert_array_equal(np.asarray(read), image)
    assert encode_png(image)[:4] == b"\x89PNG"
    flat = np.full((8, 8, 3), 120, np.uint8)
    with Image.open(io.BytesIO(encode_jpeg(flat))) as read:
        assert np.abs(np.asarray(read).astype(int) - 120).max() <= 2


@pytest.mark.parametrize(("size", "supersample"), [((0, 5), 1), ((99999, 99999), 1), ((9, 9), 5)])
def test_impossible_sizes_are_refused(size, supersample) -> None:
    camera = top_down(PLATE, aspect=1.0)
    with pytest.raises(ValueError, match="received"):
        render_mesh(PLATE, PLATE_FACES, camera, size, supersample=supersample)
