"""Photos that do not show the survey are left out; those that lie beside it are told of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from pipeline.flat_photos import LENS, SIDE_M, field_views
from scipy.ndimage import gaussian_filter, map_coordinates

from terraport_payload.types import Float32, UInt8
from terraport_pipeline.engines.photos import OpenPhotos, open_photos
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.workflow.photo_check import checked_photos

COUNT = 6

SPOTS = gaussian_filter(np.random.default_rng(8).normal(size=(240, 240)), 4.0)
"""A quarter of a metre apart: nothing comes again, as nothing does in a real place."""


def ground_colour(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """sRGB levels of the place, (N, 3) uint8."""
    spots = map_coordinates(SPOTS, [120.0 + 4.0 * east, 120.0 + 4.0 * north], order=1)
    levels = np.clip(110.0 + 40.0 * spots / SPOTS.std(), 0.0, 255.0)
    return np.repeat(np.rint(levels).astype(np.uint8)[..., None], 3, axis=-1)


def photograph(view: View) -> UInt8:
    """The photo that a view takes, (H, W, 3)."""
    column, row = np.meshgrid(np.arange(LENS.width) + 0.5, np.arange(LENS.height) + 0.5)
    rays = view.rays(np.column_stack([column.ravel(), row.ravel()]))
    ground = view.position + rays * (-view.position[1] / rays[:, 1])[:, None]
    return ground_colour(ground[:, 0], -ground[:, 2]).reshape(LENS.height, LENS.width, 3)


def ground_points() -> tuple[Float32, UInt8]:
    """Places of the field and their colours."""
    rng = np.random.default_rng(2)
    east, north = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (2, 4000))
    points = np.column_stack([east, np.zeros_like(east), -north]).astype(np.float32)
    return points, ground_colour(east, north)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Photos of the field."""
    for view in field_views(COUNT):
        PIL.Image.fromarray(photograph(view)).save(tmp_path / view.name)
    return tmp_path


def turn(path: Path) -> None:
    """Turn a photo by half."""
    levels = np.asarray(PIL.Image.open(path))
    PIL.Image.fromarray(np.ascontiguousarray(levels[::-1, ::-1])).save(path)


def opened(folder: Path, views: list[View] | None = None) -> OpenPhotos:
    return open_photos(views or field_views(COUNT), folder, max_bytes=1 << 24)


@pytest.mark.parametrize("coloured", [True, False])
def test_right_photos_stay_and_nothing_is_said(folder: Path, coloured: bool) -> None:
    points, colours = ground_points()
    checked = checked_photos(opened(folder), points, colours if coloured else None)
    assert (len(checked.views), checked.left_out, checked.warnings) == (COUNT, 0, ())


@pytest.mark.parametrize("coloured", [True, False])
def test_a_turned_photo_is_left_out(folder: Path, coloured: bool) -> None:
    points, colours = ground_points()
    turn(folder / "p3.png")
    checked = checked_photos(opened(folder), points, colours if coloured else None)
    assert [view.name for view in checked.views] == [f"p{n}.png" for n in (0, 1, 2, 4, 5)]
    assert (checked.photos.get(3) == np.asarray(PIL.Image.open(folder / "p4.png"))).all()
    assert checked.left_out == 1
    assert "1 of 6 photos show neither what the cloud nor" in checked.warnings[0]
    assert "(p3.png)" in checked.warnings[0]


def test_where_all_are_turned_none_is_left_and_that_is_said(folder: Path) -> None:
    points, colours = ground_points()
    for number in range(COUNT):
        turn(folder / f"p{number}.png")
    checked = checked_photos(opened(folder), points, colours)
    assert not checked.views
    assert "no photo is left" in checked.warnings[-1]


def test_a_damaged_photo_is_left_out(folder: Path) -> None:
    points, colours = ground_points()
    whole = (folder / "p1.png").read_bytes()
    (folder / "p1.png").write_bytes(whole[: len(whole) // 2])
    checked = checked_photos(opened(folder), points, colours)
    assert len(checked.views) == COUNT - 1
    assert "p1.png cannot be read" in checked.warnings[0]


def test_cameras_that_stand_beside_the_truth_are_told_of_with_the_distance(folder: Path) -> None:
    points, colours = ground_points()
    beside = [
        replace(view, position=view.position + np.array([2.0, 0.0, 0.0]))
        for view in field_views(COUNT)
    ]
    checked = checked_photos(opened(folder, beside), points, colours)
    assert len(checked.views) == COUNT
    assert "6 of 6 photos lie about 2." in checked.warnings[0]


def test_photos_that_agree_outvote_a_cloud_whose_colours_are_no_light(folder: Path) -> None:
    points, _ = ground_points()
    classes = np.random.default_rng(0).integers(0, 4, len(points)) * 60
    colours = np.repeat(classes.astype(np.uint8)[:, None], 3, axis=1)
    checked = checked_photos(opened(folder), points, colours)
    assert len(checked.views) == COUNT
    assert "not with the cloud's colours" in checked.warnings[0]


@pytest.mark.parametrize(("factor", "warned"), [(1.2, False), (4.0, True), (0.25, True)])
def test_photos_of_other_light_stay_and_where_it_is_far_off_that_is_said(
    folder: Path, factor: float, warned: bool
) -> None:
    points, colours = ground_points()
    for number in range(COUNT):
        path = folder / f"p{number}.png"
        light = (np.asarray(PIL.Image.open(path)) / 255.0) ** 2.2 * factor
        levels = 255.0 * np.minimum(light, 1.0) ** (1 / 2.2)
        PIL.Image.fromarray(np.rint(levels).astype(np.uint8)).save(path)
    checked = checked_photos(opened(folder), points, colours)
    assert len(checked.views) == COUNT
    assert len(checked.warnings) == warned
    assert all("times the light of the cloud's colours" in text for text in checked.warnings)


def test_a_photo_of_little_ground_is_not_judged(folder: Path) -> None:
    points, colours = ground_points()
    turn(folder / "p0.png")
    assert len(checked_photos(opened(folder), points[:150], colours[:150]).views) == COUNT
