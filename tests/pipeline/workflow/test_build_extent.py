"""A scene of an extent: the same bytes from any form of the survey, and it says what it is of."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pipeline.indexed_files import write_copc
from pipeline.laz_files import Hill, las_data, write_laz, write_tiles

from terraport_pipeline.errors import OptionError, SurveyError
from terraport_pipeline.extent import Extent
from terraport_pipeline.inspection import inspect_scene
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.report.facts import extent_line
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_store.reader import Scene

HILL = Hill(6000)
WEST = Extent(641_200, 8_594_700, 641_219, 8_594_740)
RIM_M = 2.1
"""The surface ends some four spacings beyond its last sample."""
WITHIN = int(WEST.holds(HILL.millimetres / 1000).sum())


def options_for(survey: Path, scene: Path, extent: Extent | None, **more: Any) -> BuildOptions:
    return BuildOptions(
        survey,
        scene,
        extent=extent,
        reconstruct=reconstruct.Options(base_faces=600),
        segment=segment.Options(min_faces=150, max_faces=900),
        threads=1,
        **more,
    )


def published_bytes(scene: Path) -> dict[str, bytes]:
    """Everything that is part of the published version."""
    with Scene.open(scene) as opened:
        files = {file.path for file in opened.manifest.files.values()}
    return {path: (scene / path).read_bytes() for path in ("scene.json", *files)}


def bounds_of(scene: Path) -> tuple[float, float]:
    """Least and greatest easting of a scene."""
    with Scene.open(scene) as opened:
        manifest = opened.manifest
        low, high = manifest.bounds.min[0], manifest.bounds.max[0]
        return manifest.origin[0] + low, manifest.origin[0] + high


def test_tiles_and_copc_give_one_scene_and_it_says_its_extent(tmp_path: Path) -> None:
    write_tiles(tmp_path / "tiles", HILL, margin_m=1.5)
    copc = write_copc(tmp_path / "a.copc.laz", las_data(HILL))
    report = build(options_for(tmp_path / "tiles", tmp_path / "one" / "pit", WEST))
    build(options_for(copc, tmp_path / "two" / "pit", WEST))
    scene = published_bytes(tmp_path / "one" / "pit")
    assert published_bytes(tmp_path / "two" / "pit") == scene
    # In the version: what was asked for. Beside it: what of which files lies outside.
    manifest = json.loads(scene["scene.json"])
    assert manifest["build"]["options"]["extent"] == [*WEST.values]
    assert bounds_of(tmp_path / "one" / "pit")[1] <= WEST.xmax + RIM_M
    document = json.loads((tmp_path / "one" / "pit" / "build.json").read_text())
    inputs, extent = document["inputs"], document["extent"]
    taken = sum(file["points"] - file["outside"] - file["repeats"] for file in inputs)
    assert taken == WITHIN
    left = [file for file in document["left_out"] if file["reason"] == "lies outside the extent"]
    assert extent["files"] == len(left) == 3
    assert extent["points"] > 2500
    line = extent_line(document)
    assert line.startswith("641200 8594700 641219 8594740 in the files' coordinates; ")
    assert line.endswith(" points lie outside it, 3 whole files among them")
    assert f"extent {line}" in report.notes
    assert inspect_scene(tmp_path / "one" / "pit")["extent"] == extent
    assert not any("not read" in note for note in report.notes)
    other = json.loads((tmp_path / "two" / "pit" / "build.json").read_text())
    assert other["extent"]["points"] == 6000 - WITHIN


def test_the_extent_is_a_key_of_what_is_taken_up(tmp_path: Path) -> None:
    survey = write_laz(tmp_path / "a.laz", HILL)
    build(options_for(survey, tmp_path / "pit", WEST))
    again = build(options_for(survey, tmp_path / "pit", WEST))
    assert all(stage.taken_up for stage in again.stages)
    # A survey of these points alone is another scene in one word: what was asked for.
    rows = WEST.holds(HILL.millimetres / 1000)
    alone = write_laz(tmp_path / "alone.laz", HILL, rows)
    report = build(options_for(alone, tmp_path / "pit", None))
    assert [stage.taken_up for stage in report.stages[1:-1]] == [True] * 4
    assert (
        "extent"
        not in json.loads((tmp_path / "pit" / "scene.json").read_text())["build"]["options"]
    )
    document = json.loads((tmp_path / "pit" / "build.json").read_text())
    assert "extent" not in document


def test_another_extent_over_the_scene_renews_it(tmp_path: Path) -> None:
    """Wider: ground is added, what was there is kept; narrower: what lies outside is gone."""
    survey = write_laz(tmp_path / "a.laz", HILL)
    scene = tmp_path / "pit"
    build(options_for(survey, scene, WEST))
    wide = build(options_for(survey, scene, Extent(641_200, 8_594_700, 641_240, 8_594_740)))
    assert wide.published
    renew = next(stage for stage in wide.stages if stage.name == "renew")
    assert 0.3 < renew.facts.counts["changed_share"] < 0.8
    assert bounds_of(scene)[1] > 641_238
    narrow = build(options_for(survey, scene, WEST))
    assert narrow.published
    assert bounds_of(scene)[1] <= WEST.xmax + RIM_M


def test_no_points_and_too_few_end_the_build_before_anything_is_written(tmp_path: Path) -> None:
    survey = write_copc(tmp_path / "a.copc.laz", las_data(HILL))
    with pytest.raises(SurveyError, match="has no point within extent 0 0 1 1: it spans 641200"):
        build(options_for(survey, tmp_path / "pit", Extent(0, 0, 1, 1)))
    tiny = Extent(641_200, 8_594_700, 641_200.5, 8_594_700.5)
    with pytest.raises(SurveyError, match="a surface needs at least 50"):
        build(options_for(survey, tmp_path / "pit", tiny))
    assert not (tmp_path / "pit").exists()
    with pytest.raises(OptionError, match="XMIN 5 is not below XMAX 4"):
        options_for(survey, tmp_path / "pit", Extent(5, 0, 4, 1))


def test_an_index_that_is_not_used_is_told_beside_the_version(tmp_path: Path) -> None:
    survey = write_laz(tmp_path / "a.laz", HILL)
    build(options_for(survey, tmp_path / "pit", WEST))
    before = published_bytes(tmp_path / "pit")
    (tmp_path / "a.lax").write_bytes(b"LASX")
    report = build(options_for(survey, tmp_path / "pit", WEST, resume=False))
    assert published_bytes(tmp_path / "pit") == before
    assert any("the LASindex a.lax beside it cannot be used" in note for note in report.notes)
