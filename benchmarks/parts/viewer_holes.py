"""The ground in the viewer's picture: pixels where the background shows through it.

What counts as a hole is told at the head of ``viewer.py``; ``viewer_poses.js`` counts in the page.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable
from typing import Any, Final

from browser.driven_viewer import DrivenViewer
from parts.viewer_places import corners, ground_height_m, random_place

__all__ = ["SIZE", "count_holes"]

SIZE: Final = (256, 144)
"""Of the canvas, pixels."""
BATCH: Final = 50
"""Poses of one call into the page."""
SEED: Final = 6
NOTHING: Final[dict[str, Any]] = {
    "pixels": 0,
    "ground": 0,
    "holes": 0,
    "atOutline": 0,
    "baseOnly": 0,
    "detailOnly": 0,
    "inner": 0,
    "worst": None,
}
"""What is counted of poses, before any."""


def count_holes(
    viewer: DrivenViewer, *, landings: int, poses_each: int, radius_m: float
) -> list[str]:
    """Count and print; then do harm on purpose. Returns what was missed.

    Parameters
    ----------
    viewer
        An open scene, with a canvas of `SIZE`.
    landings, poses_each
        How many landings, and camera poses at each.
    radius_m
        Largest radius of a landing; each has 0.4 to 1 of it.
    """
    chance = random.Random(SEED)
    low, high = corners(viewer)
    everything_m = math.dist(low, high)
    centre = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
    viewer.run("() => { glWatch.groundOnly = true; }")
    viewer.land((centre[0], centre[1], centre[2]), min(everything_m, 500.0))
    segments = len(viewer.visible)
    places = [random_place(viewer, chance) for _ in range(landings)]
    poses = [
        [_pose(viewer, chance, position, radius_m) for _ in range(poses_each)]
        for position in places
    ]
    base = _base_index(viewer)
    viewer.run("(id) => { glWatch.omitted = new Set([id]); }", base)
    _in_batches(poses, lambda some: _keep(viewer, "detail", some))
    viewer.run("() => { glWatch.omitted = new Set(); }")
    viewer.land((centre[0] + 10 * everything_m, centre[1], centre[2]), 1.0)
    assert viewer.visible == []
    _in_batches(poses, lambda some: _keep(viewer, "base", some))
    totals = dict(NOTHING)
    hidden = []
    for number, position in enumerate(places):
        viewer.land(position, radius_m * chance.uniform(0.4, 1.0))
        hidden.append(int(viewer.digest.split(":")[2]))
        _add(totals, _compare(viewer, number * poses_each, poses[number]))
    total = landings * poses_each
    print(f"{SIZE[0]} x {SIZE[1]}, {landings} landings x {poses_each} poses = {total},")
    print(f"scene of {segments} segments, hidden base faces {min(hidden)} to {max(hidden)}")
    print(f"pixels {totals['pixels']:,}; covered by base and detail {totals['ground']:,}")
    print(f"HOLES {totals['holes']}; at an outline {totals['atOutline']}")
    print(f"background where the base alone covers {totals['baseOnly']:,}, the detail alone")
    print(f"  {totals['detailOnly']:,}; of these not at an outline {totals['inner']:,}")
    if totals["worst"]:
        print(f"worst {json.dumps(totals['worst'])}")
    missed = [f"{totals['holes']} pixels of holes"] if totals["holes"] else []
    if not _harm_is_found(viewer, (landings - 1) * poses_each, poses[-1]):
        missed.append("harm done on purpose was not found")
    return missed


def _harm_is_found(viewer: DrivenViewer, first: int, poses: list[dict[str, Any]]) -> bool:
    """Leave out a segment, then blank base faces: holes must be found."""
    base = _base_index(viewer)
    drawn: list[list[int]] = viewer.run("glWatch.ground()")
    segment = max((entry for entry in drawn if entry[0] != base), key=lambda entry: entry[1])[0]
    viewer.run("(id) => { glWatch.omitted = new Set([id]); }", segment)
    without = _compare(viewer, first, poses)["holes"]
    viewer.run("() => { glWatch.omitted = new Set(); }")
    faces = viewer.run(
        "(id) => { const count = glWatch.ground().find((call) => call[0] === id)[1];"
        " const size = glWatch.bytesOf(id) / count;"
        " const list = glWatch.indices(id, size); const shown = [];"
        " for (let at = 0; at < count; at += 3)"
        "   if (list[at] !== list[at + 1]) shown.push(at / 3);"
        " window.baseSize = size; window.baseList = list; return shown; }",
        base,
    )
    chance = random.Random(SEED)
    for count in (1, len(faces) // 100, len(faces) // 10):
        chosen = chance.sample(faces, max(1, count))
        viewer.run(
            "([id, faces]) => { const none = new window.baseList.constructor(3);"
            " for (const face of faces) glWatch.writeFace(id, face, none); }",
            [base, chosen],
        )
        blank = _compare(viewer, first, poses)["holes"]
        viewer.run(
            "([id, faces]) => { for (const face of faces)"
            " glWatch.writeFace(id, face, window.baseList.slice(face * 3, face * 3 + 3)); }",
            [base, chosen],
        )
        print(f"harm: {len(chosen)} shown base faces blanked: {blank} pixels of holes")
    print(f"harm: one shown segment left out: {without} pixels of holes")
    again = _compare(viewer, first, poses)["holes"]
    print(f"harm undone: {again}")
    return without > 0 and blank > 0


def _base_index(viewer: DrivenViewer) -> int:
    """Return the index buffer of the base: the one with most indices."""
    viewer.look((0.0, 500.0, 0.0), 0.0, -90.0)
    calls: list[list[int]] = viewer.run("glWatch.ground()")
    return max(calls, key=lambda call: call[1])[0]


def _add(total: dict[str, Any], some: dict[str, Any]) -> None:
    for name, value in some.items():
        if name == "worst":
            worst = max((total[name], value), key=lambda view: view["holes"] if view else 0)
            total[name] = worst
        else:
            total[name] += value


def _in_batches(poses: list[list[Any]], do: Callable[[list[Any]], object]) -> None:
    flat = [pose for some in poses for pose in some]
    for at in range(0, len(flat), BATCH):
        do(flat[at : at + BATCH])


def _keep(viewer: DrivenViewer, name: str, poses: list[Any]) -> None:
    viewer.run("([name, poses]) => viewerPoses.keep(name, poses)", [name, poses])


def _compare(viewer: DrivenViewer, first: int, poses: list[Any]) -> dict[str, Any]:
    total = dict(NOTHING)
    for at in range(0, len(poses), BATCH):
        some = viewer.run(
            "([first, poses]) => viewerPoses.compare(first, poses)",
            [first + at, poses[at : at + BATCH]],
        )
        _add(total, some)
    return total


def _pose(
    viewer: DrivenViewer,
    chance: random.Random,
    position: tuple[float, float, float],
    radius_m: float,
) -> dict[str, Any]:
    """Half walk, 1.7 m over the ground near the place; half look down on it from above."""
    while True:
        turn, reach_share = chance.uniform(0, math.tau), math.sqrt(chance.random())
        reach_m = reach_share * radius_m * 0.4
        x, z = position[0] + reach_m * math.sin(turn), position[2] + reach_m * math.cos(turn)
        height_m = ground_height_m(viewer, x, z)
        if height_m is not None:
            break
    yaw = chance.uniform(0, 360)
    if chance.random() < 0.5:
        pitch = chance.uniform(-60, -3)
        return {"eye": [x, height_m + 1.7, z], "yawDeg": yaw, "pitchDeg": pitch}
    low, high = corners(viewer)
    while True:
        pitch, away_m = chance.uniform(-85, -15), chance.uniform(10, 2.5 * radius_m)
        flat_m = away_m * math.cos(math.radians(pitch))
        eye = [
            x - flat_m * math.sin(math.radians(yaw)),
            height_m - away_m * math.sin(math.radians(pitch)),
            z + flat_m * math.cos(math.radians(yaw)),
        ]
        # From outside one sees the ground's underside behind its border.
        if low[0] < eye[0] < high[0] and low[2] < eye[2] < high[2]:
            return {"eye": eye, "yawDeg": yaw, "pitchDeg": pitch}
        yaw = chance.uniform(0, 360)
