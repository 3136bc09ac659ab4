"""The comfort rule: between landings what is visible does not change, whatever the head does.

Told by the page's own digest, and by what is handed to WebGL. benchmarks/viewer.py does the same
with 10,000 poses that are all drawn.
"""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
from browser.driven_viewer import DrivenViewer
from browser.small_scenes import SMALL
from browser.watched_page import Watch
from faults.service import Service
from playwright.sync_api import Page

import terraport.sync

POSES = 10_000
DRAWN_EVERY = 200

# The camera is put anew for every pose and the digest asked; a frame (which runs the stage's
# update) is drawn in every so manieth, since all of them would take minutes by CPU.
LOOK_ABOUT = """async ([poses, drawnEvery]) => {
  const digests = new Set();
  const eyes = new Set();
  const drawn = [];
  for (const [number, [x, y, z, yawDeg, pitchDeg]] of poses.entries()) {
    const frame = terraport.look({eye: [x, y, z], yawDeg, pitchDeg});
    if (number % drawnEvery === 0) { await frame; drawn.push(glWatch.ground()); }
    digests.add(terraport.visibleDigest);
    eyes.add(`${x},${y},${z}`);
  }
  return {digests: [...digests], eyes: eyes.size, drawn};
}"""


def test_no_head_pose_changes_what_is_visible(
    open_page: Callable[..., tuple[Page, Watch]], server: Service
) -> None:
    page, _ = open_page(device_scale_factor=0.2)
    viewer = DrivenViewer(page, server.url, SMALL)
    viewer.open()
    with terraport.sync.connect(f"{server.url}/scenes/{SMALL}") as session:
        base = session.base()
        session.land((20.0, 2.0, -15.0), radius_m=45.0).ready(30)
        hidden_faces, visible = session.hidden_faces, list(session.visible)
    viewer.land((0.0, 2.0, 0.0), 60.0)
    shown = viewer.land((20.0, 2.0, -15.0), 45.0)
    assert shown["visible"] == visible
    everything = {index for index, _ in viewer.look((0.0, 700.0, 0.0), 0.0, -90.0)}
    assert len(everything) == len(shown["visible"]) + 1
    hidden = viewer.hidden_on_gpu(len(base.mesh.faces))

    chance = random.Random(6)
    poses = [
        [
            chance.uniform(-150, 150),
            chance.uniform(-5, 120),
            chance.uniform(-150, 150),
            chance.uniform(0, 360),
            chance.uniform(-90, 90),
        ]
        for _ in range(POSES)
    ]
    observed = viewer.run(LOOK_ABOUT, [poses, DRAWN_EVERY])
    assert observed["digests"] == [shown["digest"]]
    assert observed["eyes"] == POSES
    # No frame drew anything else, though they were not alike: what is out of sight is left out.
    assert len(observed["drawn"]) == POSES // DRAWN_EVERY
    drawn = [{index for index, _ in frame} for frame in observed["drawn"]]
    assert all(frame <= everything for frame in drawn)
    assert len({len(frame) for frame in drawn}) > 5
    # And the base's list of faces on the GPU is still the same, and the one that the rule wants.
    viewer.look((0.0, 700.0, 0.0), 0.0, -90.0)
    assert np.array_equal(viewer.hidden_on_gpu(len(base.mesh.faces)), hidden)
    assert np.array_equal(hidden, hidden_faces)
    assert viewer.run("terraport.state.strayChanges") == 0


def test_what_is_drawn_is_what_is_in_view(page: Page, server: Service) -> None:
    """Each frame draws the visible segments whose sphere reaches into the view, and no others."""
    viewer = DrivenViewer(page, server.url, SMALL)
    viewer.open()
    plan = viewer.land((0.0, 2.0, 0.0), 60.0)["plan"]
    faces = sorted(row["faces"] for row in plan["show"])
    with terraport.sync.connect(f"{server.url}/scenes/{SMALL}") as session:
        segments = session.land((0.0, 2.0, 0.0), radius_m=60.0).ready(30)
        points = [segment.arrays().positions for segment in segments]
    boxes = np.array([[*each.min(axis=0), *each.max(axis=0)] for each in points])
    everything = viewer.look((0.0, 700.0, 0.0), 0.0, -90.0)
    base = max(everything, key=lambda call: call[1])
    assert sorted(count // 3 for index, count in everything if index != base[0]) == faces

    centres = (boxes[:, :3] + boxes[:, 3:]) / 2
    radii = np.linalg.norm(boxes[:, 3:] - boxes[:, :3], axis=1) / 2
    chance = random.Random(7)
    numbers = set()
    for _ in range(40):
        eye = np.array([chance.uniform(-60, 60), chance.uniform(2, 60), chance.uniform(-60, 60)])
        yaw, pitch = chance.uniform(0, 360), chance.uniform(-80, 30)
        calls = viewer.look((float(eye[0]), float(eye[1]), float(eye[2])), yaw, pitch)
        count = sum(index != base[0] for index, _ in calls)
        inside = _depth_in_view(eye, yaw, pitch, centres) + radii
        # A sphere that only touches the border may be taken either way.
        assert np.sum(inside > 0.01) <= count <= np.sum(inside > -0.01)
        numbers.add(count)
    assert len(numbers) > 10


def _depth_in_view(
    eye: np.ndarray, yaw_deg: float, pitch_deg: float, points: np.ndarray
) -> np.ndarray:
    """Return how deep points lie within the view's side planes: the least of the distances."""
    yaw, pitch = np.radians([yaw_deg, pitch_deg])
    ahead = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), -np.cos(yaw) * np.cos(pitch)])
    right = np.array([np.cos(yaw), 0.0, np.sin(yaw)])
    up = np.cross(right, ahead)
    away = points - eye
    x, y, z = away @ right, away @ up, away @ ahead
    tall = np.radians(55.0 / 2)
    wide = np.arctan(np.tan(tall) * 640 / 360)
    sides = [
        z * np.sin(wide) - x * np.cos(wide),
        z * np.sin(wide) + x * np.cos(wide),
        z * np.sin(tall) - y * np.cos(tall),
        z * np.sin(tall) + y * np.cos(tall),
        z - 0.1,
    ]
    depth: np.ndarray = np.min(sides, axis=0)
    return depth


def test_frames_cost_little_while_a_landing_streams(
    open_page: Callable[..., tuple[Page, Watch]], server: Service
) -> None:
    """Our own work is done in slices; no figure here depends on how fast the machine is.

    benchmarks/viewer.py has the milliseconds.
    """
    page, _ = open_page(device_scale_factor=0.1)
    viewer = DrivenViewer(page, server.url, SMALL)
    viewer.open()
    viewer.run("() => { glWatch.uploads.length = 0; }")
    shown = viewer.land((0.0, 2.0, 0.0), 60.0)
    uploads = viewer.run("glWatch.uploads")
    # By frame: bytes handed over. No frame takes all, none more than the bound of terrain.ts.
    assert len([some for some in uploads if some > 0]) > 1
    assert max(uploads) <= 7 << 20
    assert sum(uploads) >= sum(entry["faces"] for entry in shown["plan"]["show"]) * 6
