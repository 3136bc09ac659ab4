"""The picture of the worst place: a hole is magenta in it, and it stands where it was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from terraport_pipeline.published.scene_model import load_scene_model
from terraport_pipeline.validate.handoff import check_hand_off
from terraport_pipeline.validate.handoff_report import HandOffOptions, WorstRay
from terraport_pipeline.validate.worst_place import (
    NOTHING,
    compare_at,
    describe,
    difference_colours,
    sight_of,
    to_survey,
)
from terraport_store import Scene

SIZE = (160, 120)


def worst_of(path):
    with Scene.open(path) as scene:
        model = load_scene_model(scene)
    # Of these rays none ends at an outline against the sky, which is excused but coloured too.
    report = check_hand_off(model.hand_off_model(), HandOffOptions(4_000, 10, seed=6))
    assert report.worst is not None
    return model, report.worst


def third_panel(image):
    panel = image[22:, 2 * (SIZE[0] + 6) :]
    assert panel.shape == (SIZE[1], SIZE[0], 3)
    return panel


def test_a_good_scene_has_a_picture_without_holes(scene_path) -> None:
    model, worst = worst_of(scene_path)
    image = compare_at(model, worst, size=SIZE, supersample=1)
    assert image.shape == (SIZE[1] + 22, 3 * SIZE[0] + 12, 3)
    for left in (0, SIZE[0] + 6):  # not blank: the ground has texture
        assert image[22:, left : left + SIZE[0]].std() > 5
    assert not (third_panel(image) == NOTHING).all(axis=2).any()
    assert worst.verdict != "hole"
    assert describe(worst).endswith("m from the full detail")


def test_a_hole_is_magenta_where_it_was_found(write_scene, model, detail, base, tmp_path) -> None:
    first = model.cover_segments[model.cover_offsets[:-1]]
    wrong = replace(
        model,
        cover_offsets=np.arange(len(model.base_faces) + 1, dtype=np.uint32),
        cover_segments=first,
    )
    scene, worst = worst_of(write_scene(tmp_path / "wrong", wrong, detail, base))
    assert worst.verdict == describe(worst).split()[-1] == "hole"
    panel = third_panel(compare_at(scene, worst, size=SIZE, supersample=1))
    middle = panel[SIZE[1] // 2 - 2 : SIZE[1] // 2 + 2, SIZE[0] // 2 - 2 : SIZE[0] // 2 + 2]
    worse = (middle == NOTHING).all(axis=2) | (middle[..., 0] > middle[..., 2] + 20)
    assert worse.any()  # nothing, or something further, within the ring


def test_colours_tell_nearer_further_and_nothing() -> None:
    full = np.float32([5, 5, 5, 5, np.inf, np.inf])
    mixed = np.float32([5.05, 4, 6, np.inf, 3, np.inf])
    same, near, far, nothing, before, sky = difference_colours(full, mixed, 0.1).astype(int)
    assert same[0] == same[2]
    assert near[2] > near[0] + 50
    assert far[0] > far[2] + 50
    assert (nothing == NOTHING).all()
    assert before[2] > before[0] + 50
    assert (sky == 255).all()


@pytest.mark.parametrize("direction", [(0.0, -1.0, 0.0), (0.6, -0.8, 0.0)])
def test_the_camera_looks_along_the_ray_from_nearby(direction) -> None:
    target = np.array([10.0, 2.0, -5.0])
    origin = target - 90 * np.array(direction)
    worst = WorstRay(
        tuple(origin), direction, tuple(target), float("inf"), True, "hole", "down", (1,)
    )
    camera = sight_of(worst, 0.1)
    np.testing.assert_allclose(np.linalg.norm(target - np.array(camera.eye)), 12.0)
    np.testing.assert_allclose(camera.project(target[None], 100, 100)[:2], [[50], [50]])
    assert np.linalg.norm(target - np.array(sight_of(worst, 1.0).eye)) == pytest.approx(30.0)


def test_survey_coordinates_turn_the_frame_back() -> None:
    assert to_survey((100.0, 200.0, 10.0), (1.0, 2.0, 3.0)) == (101.0, 197.0, 12.0)


def test_a_png_can_be_written_and_read(scene_path, tmp_path) -> None:
    from terraport_pipeline.errors import OptionError
    from terraport_pipeline.validate.validation import ValidationOptions, validate

    path = tmp_path / "worst.png"
    rays = HandOffOptions(2_000, 4)
    result = validate(scene_path, ValidationOptions(rays, picture=path))
    assert result.picture == path
    assert result.hand_off_seconds > 0
    with Image.open(path) as image:
        assert image.size == (3 * 560 + 12, 420 + 22)
    missing = ValidationOptions(rays, picture=tmp_path / "no" / "worst.png")
    with pytest.raises(OptionError, match="expected an existing folder"):
        validate(scene_path, missing)
