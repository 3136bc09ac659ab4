"""Names that were drawn or taught outlast the next build of the scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pipeline.naming.named_ground import (
    ground_at,
    plan_at,
    square,
    write_geojson,
    write_named_ground,
)

from terraport_pipeline.naming.carried import NOTE_NAME, bring_names, note_names
from terraport_pipeline.naming.plan import label_by_plan
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages import reconstruct, segment
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_pipeline.workflow.report import BuildReport
from terraport_store import Scene, change_labels, read_manifest, validate_scene

PIT = square(10, -60, 70, -10)


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


def test_a_drawn_name_is_brought_and_the_note_goes(scene: Path, tmp_path: Path) -> None:
    note = tmp_path / NOTE_NAME
    note_names(scene, note, NullProgress())
    assert not note.exists()  # nothing was drawn: regions that the engine made go by their ids
    label_by_plan(scene, write_geojson(tmp_path / "p.geojson", [("pit", PIT)]), NullProgress())
    with Scene.open(scene) as opened:
        (drawn,) = [row["stable_id"] for row in opened.regions["regions"] if row.get("drawn")]
    change_labels(scene, {drawn: "north pit"})  # what people call it since
    note_names(scene, note, NullProgress())
    assert note.exists()
    # The next build, killed after publishing: the note stays, and says what was before it.
    write_named_ground(scene, seed=1)
    note_names(scene, note, NullProgress())
    version = read_manifest(scene).version
    said, brought = bring_names(scene, note, NullProgress())
    assert "1 regions that were drawn or taught were brought" in said[0]
    assert brought == read_manifest(scene).version != version
    assert named_share(scene, "north pit", 10, -60, 70, -10) > 0.99
    with Scene.open(scene) as opened:
        rows = opened.regions["regions"]
    assert [row["stable_id"] for row in rows if row.get("drawn")] == [drawn]
    assert validate_scene(scene) == []
    assert not note.exists()
    assert bring_names(scene, note, NullProgress()) == ([], None)


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
