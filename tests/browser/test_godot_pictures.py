"""Three landings in Godot look as they do in the viewer, and no background shows through ground.

``benchmarks/godot_client.py`` compares twenty, and looks for background in a hundred.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from browser.driven_viewer import DrivenViewer
from browser.small_scenes import PHOTOGRAPHED, SMALL
from browser.watched_page import Watch
from faults.service import Service
from godot.conftest import godot
from godot.engine import Engine
from godot.pictures import (
    SIZE,
    apart,
    background_in_ground,
    from_godot,
    from_viewer,
    poses_around,
    read_godot,
    visit,
)
from playwright.sync_api import Page

__all__ = ["godot"]

OpenPage = Callable[..., tuple[Page, Watch]]

PLACES = ((0.0, 2.0, 0.0, 45.0), (-35.0, 4.0, 20.0, 30.0), (20.0, 3.0, -30.0, 25.0))
MEAN, FAR_SHARE, UNCOVERED = 2.0, 0.01, 0.001
"""Tolerated: see `godot.pictures.Apart`."""


@pytest.mark.parametrize("scene", [SMALL, PHOTOGRAPHED])
def test_landings_look_as_in_the_viewer(
    godot: Engine, open_page: OpenPage, server: Service, scene: str, tmp_path: Path
) -> None:
    chance = random.Random(4)
    poses = [poses_around(place[:3], chance, place[3], 2) for place in PLACES]
    steps = []
    for number, place in enumerate(PLACES):
        steps += [["land", *place], *from_godot(poses[number], tmp_path, str(number))]
    done = visit(godot, f"{server.url}/scenes/{scene}", *steps)
    assert done.failure == ""
    width, height = SIZE
    page, _ = open_page(
        reduced_motion="reduce",
        viewport={"width": 2 * width, "height": 2 * height},
        device_scale_factor=0.5,
    )
    viewer = DrivenViewer(page, server.url, scene)
    viewer.open("&mode=colour")
    pictures = []
    for number, (x, y, z, radius_m) in enumerate(PLACES):
        landed = viewer.land((x, y, z), radius_m)
        # The base's faces stand in an order of their own in Godot, so their hash differs.
        drawn_there = done.results[3 * number]["digest"].rpartition(":")[0]
        assert landed["digest"].rpartition(":")[0] == drawn_there, "the same is drawn"
        for at, pose in enumerate(poses[number]):
            drawn = read_godot(tmp_path / f"{number}-{at}.png")
            difference = apart(drawn, from_viewer(viewer, pose))
            assert difference.mean <= MEAN, difference
            assert difference.far <= FAR_SHARE, difference
            assert difference.uncovered <= UNCOVERED, difference
            pictures.append(drawn)
    # A picture of another place is found; so is one that is a little darker.
    assert apart(pictures[0], pictures[2]).mean > MEAN
    darker = (pictures[0][0] * 0.97).astype(np.uint8)
    assert apart(pictures[0], (darker, pictures[0][1])).mean > MEAN


def test_no_background_shows_through_the_ground(
    godot: Engine, server: Service, tmp_path: Path
) -> None:
    chance = random.Random(5)
    everything, nothing = ["land", 0, 2, 0, 400], ["land", 5000, 0, 0, 1]
    poses = [poses_around(place[:3], chance, place[3], 4) for place in PLACES]
    steps = [everything]
    for number, some in enumerate(poses):
        steps += from_godot(some, tmp_path, f"detail-{number}")
    steps.append(nothing)
    for number, some in enumerate(poses):
        steps += from_godot(some, tmp_path, f"base-{number}")
    for number, place in enumerate(PLACES):
        steps += [["land", *place], *from_godot(poses[number], tmp_path, f"mixed-{number}")]
    done = visit(godot, f"{server.url}/scenes/{SMALL}", *steps)
    assert done.failure == ""
    covered = 0
    for number, some in enumerate(poses):
        for at in range(len(some)):
            mixed, base, detail = (
                read_godot(tmp_path / f"{name}-{number}-{at}.png")[1]
                for name in ("mixed", "base", "detail")
            )
            covered += int((base & detail).sum())
            assert background_in_ground(mixed, base, detail) == 0
            # A hole of one pixel in the middle of the ground is found.
            row, column = np.argwhere(base & detail)[(base & detail).sum() // 2]
            mixed[row, column] = False
            assert background_in_ground(mixed, base, detail) <= 1
    assert covered > 100_000
