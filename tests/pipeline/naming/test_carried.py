"""Names that were drawn or taught outlast the next build of the scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pipeline.naming.named_ground import (
    FACTS,
    ground_at,
    plan_at,
    square,
    write_geojson,
    write_named_ground,
)

from terraport_pipeline.naming.carried import NOTE_NAME, UNNAMED_NAME, bring_names, note_names
from terraport_pipeline.naming.plan import label_by_plan
from terraport_pipeline.naming.recut import Cut, recut
from terraport_pipeline.naming.republish import republish
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.published.ground import read_ground
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_pipeline.workflow.report import BuildReport
from terraport_store import Scene, SceneBusyError, change_labels, read_manifest, validate_scene

PIT = square(10, -60, 70, -10)


def regions_of(scene: Path) -> tuple[list[dict[str, Any]], int]:
    """Rows of regions.json, and the next stable id."""
    with Scene.open(scene) as opened:
        return opened.regions["regions"], opened.regions["next_stable_id"]


def named_share(scene: Path, name: str, x0: float, y0: float, x1: float, y1: float) -> float:
    """Share of a square's faces whose region has the name; 0 if one outside has it."""
    ground = ground_at(scene)
    x, y = plan_at(ground)
    inside = (x > x0) & (x < x1) & (y > y0) & (y < y1)
    called = [ground.names.label(n) == name for n in range(len(ground.document["regions"]))]
    has = np.array(called)[ground.region_of_face]
    near = (x > x0 - 2) & (x < x1 + 2) & (y > y0 - 2) & (y < y1 + 2)
    assert not has[~near].any()
    return float(has[inside].mean())


def test_a_drawn_name_is_brought_and_no_id_is_used_up(scene: Path, tmp_path: Path) -> None:
    note, unnamed = tmp_path / NOTE_NAME, tmp_path / "unnamed"
    assert note_names(scene, note, 1, NullProgress()) == []
    assert not note.exists()  # nothing was drawn: regions that the engine made go by their ids
    label_by_plan(scene, write_geojson(tmp_path / "p.geojson", [("pit", PIT)]), NullProgress())
    rows, free = regions_of(scene)
    (drawn,) = [row["stable_id"] for row in rows if row.get("drawn")]
    change_labels(scene, {drawn: "north pit"})  # what people call it since
    # The next build's own version, which nobody sees: its ids are none of the scene's.
    facts = {
        **FACTS, "next_stable_id": 90,
        "regions": [{"id": 0, "stable_id": 40}, {"id": 1, "stable_id": 70}],
    }  # fmt: skip
    write_named_ground(unnamed, seed=1, facts=facts)
    before = read_manifest(scene).version
    assert note_names(scene, note, 1, NullProgress()) == []
    said, brought = bring_names(unnamed, scene, note, NullProgress())
    assert "1 regions that were drawn or taught were brought" in said[0]
    assert brought == read_manifest(scene).version != before
    assert named_share(scene, "north pit", 10, -60, 70, -10) > 0.99
    again, free_again = regions_of(scene)
    assert [row["stable_id"] for row in again if row.get("drawn")] == [drawn]
    assert {row["stable_id"] for row in again} == {row["stable_id"] for row in rows}
    assert free_again == free
    assert validate_scene(scene) == []
    # Once more from the same: the same version.
    assert note_names(scene, note, 1, NullProgress()) == []
    assert bring_names(unnamed, scene, note, NullProgress())[1] == brought


def test_new_ground_takes_an_id_that_was_never_used(scene: Path, tmp_path: Path) -> None:
    note, unnamed = tmp_path / NOTE_NAME, tmp_path / "unnamed"
    label_by_plan(scene, write_geojson(tmp_path / "p.geojson", [("pit", PIT)]), NullProgress())
    rows, free = regions_of(scene)
    note_names(scene, note, 1, NullProgress())
    write_named_ground(unnamed, facts={**FACTS, "next_stable_id": 90})
    with Scene.open(unnamed) as opened:  # the engine cuts the eastern ground in two
        ground = read_ground(opened, NullProgress())
        south = (ground.region_of_face == 1) & (ground.centres[:, 2] > 75)
        pieces = np.where(south, 2, ground.region_of_face).astype(np.int32)
        republish(opened, ground, recut(ground, Cut(pieces)), NullProgress())
    bring_names(unnamed, scene, note, NullProgress())
    again, free_again = regions_of(scene)
    new = {row["stable_id"] for row in again} - {row["stable_id"] for row in rows}
    assert new == {free}
    assert free_again == free + 1


def test_names_are_not_brought_over_what_somebody_published_since(
    scene: Path, tmp_path: Path
) -> None:
    note, unnamed = tmp_path / NOTE_NAME, tmp_path / "unnamed"
    label_by_plan(scene, write_geojson(tmp_path / "p.geojson", [("pit", PIT)]), NullProgress())
    note_names(scene, note, 1, NullProgress())
    write_named_ground(unnamed, seed=1)
    other = write_geojson(tmp_path / "q.geojson", [("pond", square(70, -60, 90, -40))])
    label_by_plan(scene, other, NullProgress())
    version = read_manifest(scene).version
    with pytest.raises(SceneBusyError):
        bring_names(unnamed, scene, note, NullProgress())
    assert read_manifest(scene).version == version


def survey(folder: Path, seed: int, *, dug: bool) -> Path:
    """A slope of 40 m in one colour; a hole in its south-west the second time."""
    rng = np.random.default_rng(seed)
    east, north = rng.uniform(0, 40.0, (2, 14_000))
    height = 0.1 * east + 0.5 * np.sin(north / 9.0) + rng.normal(0, 0.01, len(east))
    if dug:
        height -= 1.5 * np.maximum(1 - (np.hypot(east - 8, north - 8) / 6) ** 2, 0)
    colour = np.where(east < 20, 200, 60)
    rows = np.column_stack(
        [east + 500_000.0, north + 6_000_000.0, height + 100.0, colour, 260 - colour, colour]
    )
    path = folder / f"{seed}.xyz"
    np.savetxt(path, rows, fmt=["%.4f"] * 3 + ["%d"] * 3)
    return path


def built(folder: Path, seed: int, *, dug: bool) -> BuildReport:
    return build(
        BuildOptions(
            survey(folder, seed, dug=dug), folder / "scene", threads=1, base_texture=0,
            reconstruct=reconstruct.Options(base_faces=1000),
            segment=segment.Options(min_faces=300, max_faces=1500),
        )
    )  # fmt: skip


def test_the_next_survey_keeps_what_the_mine_has_drawn(tmp_path: Path) -> None:
    built(tmp_path, 1, dug=False)
    scene = tmp_path / "scene"
    with Scene.open(scene) as opened:
        east, north = opened.manifest.origin[0] - 500_000.0, opened.manifest.origin[1] - 6_000_000.0
    bench = (22.0, 22.0, 34.0, 32.0)  # in the north-east, in one colour with what is around
    plan = write_geojson(tmp_path / "p.geojson", [("bench", square(*bench))], epsg=None)
    label_by_plan(scene, plan, NullProgress())
    about = (bench[0] - east, bench[1] - north, bench[2] - east, bench[3] - north)
    assert named_share(scene, "bench", *about) > 0.95
    report = built(tmp_path, 2, dug=True)
    assert report.version == read_manifest(scene).version
    assert named_share(scene, "bench", *about) > 0.95
    warnings = [text for stage in report.stages for text in stage.facts.warnings]
    assert any("were brought from version" in text for text in warnings)
    assert not any("have no region any more" in text for text in warnings)
    with Scene.open(scene) as opened:
        # The build did not start anew: it knows what the hole took away.
        assert opened.regions["change"]["whole"]["cut_m3"] == pytest.approx(85, rel=0.1)
    # The same survey over the names once more, twice: one version, and no id is used up.
    rows, free = regions_of(scene)
    for _ in range(2):
        again = built(tmp_path, 2, dug=True)
        assert again.version == report.version
        assert not again.published
    assert regions_of(scene) == (rows, free)
    work = tmp_path / ".scene.work"
    assert not (work / NOTE_NAME).exists()
    assert not (work / UNNAMED_NAME).exists()
