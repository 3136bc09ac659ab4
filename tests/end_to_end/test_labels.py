"""A region's name from the user's table to a pick, and through a rebuild of the same survey.

Like the whole-path tests, on the procedural quarry. The second survey is the same quarry scanned
again: other noise, and a corner of the site was not reached this time.
"""

from __future__ import annotations

import csv
import json
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from command_line import Built, run_terraport

import terraport.sync
from terraport_pipeline.model import to_scene
from terraport_server.background_server import BackgroundServer
from terraport_store import Scene, read_names, validate_scene

BUILD = (
    "--no-report",
    "--engine",
    "tpa",
    "--tpa-region-threshold",
    "0.35",
    "--small-region-share",
    "0.01",
)


@dataclass(frozen=True)
class Rebuilt:
    """One scene before and after, as the command line left it."""

    scenes: Path
    before: dict[str, Any]
    """regions.json of the first build."""
    after: dict[str, Any]
    labels: dict[int, str]
    """Set before the second build."""
    output: str
    """What the second build printed."""
    places: dict[int, list[float]]
    """A point well inside each region of the first build, survey coordinates, by stable id."""


def rescanned(first: Path, second: Path) -> None:
    """Move every point by a millimetre or ten and leave out a corner of the site."""
    las = laspy.read(first)
    rng = np.random.default_rng(5)
    xyz = np.asarray(las.xyz)
    share = (xyz[:, :2] - xyz[:, :2].min(axis=0)) / np.ptp(xyz[:, :2], axis=0)
    kept = (share.sum(axis=1) > 0.25) & (rng.random(len(xyz)) < 0.97)
    las.points = las.points[kept]
    moved = xyz[kept] + rng.normal(0.0, 0.01, (int(kept.sum()), 3))
    las.x, las.y, las.z = moved.T
    las.write(second)


def regions_of(scene: Path) -> dict[str, Any]:
    return read_names(scene)[1]


def inner_places(scene: Path) -> dict[int, list[float]]:
    """The middle of each region's largest single-region segment, from above."""
    points: dict[int, list[float]] = {}
    with Scene.open(scene) as opened:
        origin = np.array(opened.manifest.origin)
        names = read_names(scene)[0]
        order = np.argsort(-opened.index.face_count.astype(int), kind="stable")
        for segment in order[opened.index.region_count[order] == 1].tolist():
            number = names.stable_id(int(opened.index.region[segment]))
            if number is None or number in points:
                continue
            mesh = opened.mesh(segment)
            centres = mesh.positions[mesh.faces].astype(float).mean(axis=1)
            middle = np.abs(centres - np.median(centres, axis=0)).sum(axis=1).argmin()
            x, y, z = centres[middle]
            points[number] = [origin[0] + x, origin[1] - z, origin[2] + y]
    return points


@pytest.fixture(scope="module")
def rebuilt(built: Built, tmp_path_factory: pytest.TempPathFactory) -> Rebuilt:
    root = tmp_path_factory.mktemp("labels")
    scene, table = root / "scenes" / "pit", root / "regions.csv"
    done = run_terraport("build", built.survey, "-o", scene, *BUILD)
    assert done.returncode == 0, done.stderr
    before, places = regions_of(scene), inner_places(scene)
    assert run_terraport("label", scene, "--export", table).returncode == 0
    with table.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row["label"] = f"piece {row['stable_id']} of {row['surface_area_m2']} m²"
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    done = run_terraport("label", scene, table)
    assert done.returncode == 0, done.stderr
    second = root / "second.laz"
    rescanned(built.survey, second)
    done = run_terraport("build", second, "-o", scene, *BUILD)
    assert done.returncode == 0, done.stderr
    return Rebuilt(
        scene.parent,
        before,
        regions_of(scene),
        {int(row["stable_id"]): row["label"] for row in rows},
        done.stdout + done.stderr,
        places,
    )


@pytest.fixture(scope="module")
def server(rebuilt: Rebuilt) -> Iterator[BackgroundServer]:
    with BackgroundServer(rebuilt.scenes) as running:
        yield running


def by_id(document: dict[str, Any]) -> dict[int, dict[str, Any]]:
    return {row["stable_id"]: row for row in document["regions"]}


def test_the_first_build_counts_from_0(rebuilt: Rebuilt) -> None:
    rows = rebuilt.before["regions"]
    assert len(rows) >= 3
    assert [row["stable_id"] for row in rows] == list(range(len(rows)))
    assert rebuilt.before["next_stable_id"] == len(rows)


def test_most_of_the_ground_keeps_its_number(rebuilt: Rebuilt) -> None:
    """Nine tenths of the area, and what has a number is where it was."""
    before, after = by_id(rebuilt.before), by_id(rebuilt.after)
    kept = before.keys() & after.keys()
    area = sum(after[number]["area_m2"] for number in kept)
    assert area > 0.9 * sum(row["area_m2"] for row in after.values())
    for number in kept:
        ratio = after[number]["area_m2"] / before[number]["area_m2"]
        assert 0.25 < ratio < 4.0


def test_new_regions_have_numbers_never_used_and_lost_labels_are_told(rebuilt: Rebuilt) -> None:
    before, after = by_id(rebuilt.before), by_id(rebuilt.after)
    first_free = rebuilt.before["next_stable_id"]
    assert all(number >= first_free for number in after.keys() - before.keys())
    assert rebuilt.after["next_stable_id"] == first_free + len(after.keys() - before.keys())
    gone = before.keys() - after.keys()
    assert ("labels have no region any more" in rebuilt.output) == bool(gone)
    for number in gone:
        assert f"({number})" in rebuilt.output
    assert validate_scene(rebuilt.scenes / "pit") == []


def test_a_pick_after_the_rebuild_answers_with_the_label_of_before(
    rebuilt: Rebuilt, server: BackgroundServer
) -> None:
    """From above, at a place well inside each region that was there before."""
    after = by_id(rebuilt.after)
    pick_count = 0
    with Scene.open(rebuilt.scenes / "pit") as scene:
        origin = np.array(scene.manifest.origin)
    with terraport.sync.connect(server.scene_url("pit")) as session:
        for number, point in rebuilt.places.items():
            if number not in after:
                continue
            position = to_scene(np.array([point]), origin)[0].tolist()
            hit = session.pick(position)
            if hit is None or hit.stable_id != number:
                continue  # the border moved over this place, or the corner is gone
            assert hit.label == rebuilt.labels[number]
            assert rebuilt.after["regions"][hit.region]["stable_id"] == number
            pick_count += 1
    assert pick_count >= min(3, len(after.keys() & rebuilt.places.keys()))


def test_a_running_service_answers_with_a_new_label_at_once(
    rebuilt: Rebuilt, server: BackgroundServer, tmp_path: Path
) -> None:
    """Set on the command line, in the next picks of a session that is open already."""
    scene = rebuilt.scenes / "pit"
    number, point = next((n, p) for n, p in rebuilt.places.items() if n in by_id(rebuilt.after))
    with Scene.open(scene) as opened:
        position = to_scene(np.array([point]), np.array(opened.manifest.origin))[0].tolist()
    table = tmp_path / "one.csv"
    with terraport.sync.connect(server.scene_url("pit")) as session:
        hit = session.pick(position)
        assert hit is not None
        number = hit.stable_id
        table.write_text(f"stable_id,label\n{number},Süd-Halde 石\n", encoding="utf-8")
        before = {path: path.stat().st_mtime_ns for path in scene.rglob("v-*/*")}
        assert run_terraport("label", scene, table).returncode == 0
        end = time.monotonic() + 30
        while hit is not None and hit.label != "Süd-Halde 石" and time.monotonic() < end:
            time.sleep(0.05)
            hit = session.pick(position)
    assert hit is not None
    assert (hit.stable_id, hit.label) == (number, "Süd-Halde 石")
    assert {path: path.stat().st_mtime_ns for path in scene.rglob("v-*/*")} == before


@pytest.mark.thorough
def test_the_same_survey_over_the_same_version_gives_the_same_bytes(
    rebuilt: Rebuilt, built: Built, tmp_path: Path
) -> None:
    """Two copies of the place, each built over; and once more over itself: nothing changes."""
    versions, numbers = [], []
    for name in ("a", "b"):
        scene = tmp_path / name / "pit"
        shutil.copytree(rebuilt.scenes / "pit", scene)
        shutil.copytree(rebuilt.scenes / ".pit.work", scene.parent / ".pit.work")
        done = run_terraport("build", built.survey, "-o", scene, *BUILD)
        assert done.returncode == 0, done.stderr
        versions.append(json.loads((scene / "scene.json").read_text())["version"])
        numbers.append([row["stable_id"] for row in regions_of(scene)["regions"]])
    assert versions[0] == versions[1]
    assert numbers[0] == numbers[1]
    (tmp_path / "a" / "pit" / "build.json").unlink()
    shutil.rmtree(tmp_path / "a" / ".pit.work" / "pack")
    done = run_terraport("build", built.survey, "-o", tmp_path / "a" / "pit", *BUILD)
    assert done.returncode == 0, done.stderr
    again = json.loads((tmp_path / "a" / "pit" / "scene.json").read_text())["version"]
    assert again == versions[0]
