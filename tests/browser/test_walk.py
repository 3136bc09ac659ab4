"""Feet on the ground that the page shows: 200 m over detail and base, beside the Python SDK."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser.driven_viewer import DrivenViewer
from engines.walk import BOUND_M, LANDING, STEPS, places, shown_by_the_sdk
from faults.service import Service
from playwright.sync_api import Page
from server.grid_scene import write_grid_scene


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Service, float]]:
    """A service with the grid scene, and how far its base is pushed back, metres."""
    root = tmp_path_factory.mktemp("scenes")
    write_grid_scene(root / "grid")
    with Service(root) as running:
        yield running, _push_m(root / "grid")


def _push_m(scene: Path) -> float:
    manifest = json.loads((scene / "scene.json").read_bytes())
    return float(manifest["hand_off"]["deviation_m"])


def test_feet_stand_on_what_is_shown(page: Page, grid: tuple[Service, float]) -> None:
    server, push_m = grid
    ground = shown_by_the_sdk(f"{server.url}/scenes/grid")
    viewer = DrivenViewer(page, server.url, "grid")
    viewer.open()
    viewer.land(LANDING[:3], LANDING[3])
    walk = places().tolist()
    feet = viewer.run(
        "(places) => places.map(([x, z]) => terraport.cast([x, 100, z], [0, -1, 0]))"
        ".map((hit) => hit && [hit.position[1], hit.segment])",
        walk,
    )
    assert len(feet) == STEPS
    apart_m, on_detail = [], 0
    for (x, z), foot in zip(walk, feet, strict=True):
        expected = ground.height_m(x, z, push_m)
        assert (foot is None) == (expected is None), (x, z)
        if foot is not None and expected is not None:
            apart_m.append(abs(foot[0] - expected[0]))
            on_detail += foot[1] >= 0
    assert 20 < on_detail < len(apart_m) - 20, "the walk is on detail, and on the base"
    assert max(apart_m) <= BOUND_M, max(apart_m)
