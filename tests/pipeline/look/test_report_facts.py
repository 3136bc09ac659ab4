"""What a report says of the regions."""

from __future__ import annotations

import json
from pathlib import Path

from store.tiny_scene import write_tiny_scene

from terraport_pipeline.report.class_facts import name_table
from terraport_pipeline.report.facts import collect_facts, extent_line
from terraport_pipeline.report.survey_crs import tiles_line
from terraport_pipeline.report.survey_units import SurveyUnit
from terraport_store import CrsInfo, Scene, SceneWriter, change_labels


def with_facts(path: Path) -> Path:
    """A tiny scene whose regions have facts; region 2 is the largest."""
    row = {
        "faces": 7, "slope_deg": {"mean": 12.4, "p90": 30.0}, "roughness_m": 0.0123,
        "height_m": {"min": 1.0, "mean": 2.0, "max": 3.5}, "mean_colour": [1.0, 2.0, 255.0],
    }  # fmt: skip
    original = SceneWriter.set_regions

    def set_regions(self, regions):
        rows = [{**region, **row, "area_m2": 10.0 + region["id"]} for region in regions["regions"]]
        original(self, {**regions, "roughness_scale_m": 2.0, "regions": rows})

    SceneWriter.set_regions = set_regions
    try:
        return write_tiny_scene(path, stable_ids=(4, 2, 9)).path
    finally:
        SceneWriter.set_regions = original


def test_regions_in_order_of_area_with_labels_and_stable_ids(tmp_path: Path) -> None:
    scene = with_facts(tmp_path / "s")
    change_labels(scene, {9: "<haul> road"})
    with Scene.open(scene) as opened:
        facts = collect_facts(opened, has_input=False)
    assert facts.region_columns == (
        "label", "surface m²", "triangles", "mean colour", "slope", "roughness m", "height m",
    )  # fmt: skip
    assert [row["name"] for row in facts.regions] == ["9", "2", "4"]
    assert [cell["text"] for cell in facts.regions[0]["cells"]] == [
        "<haul> road", "12", "7", "", "12°", "0.012", "101.0 to 103.5",
    ]  # fmt: skip
    assert facts.regions[0]["cells"][3]["swatch"] == "#0102ff"
    assert [row["cells"][0]["text"] for row in facts.regions] == ["<haul> road", "bench", ""]
    assert "the number the stable id" in facts.regions_note
    assert "cubes of 2 m" in facts.regions_note


def test_damaged_labels_are_said_and_the_table_stays(tmp_path: Path) -> None:
    scene = write_tiny_scene(tmp_path / "s", stable_ids=(4, 2, 9)).path
    (scene / "labels.json").write_text("{}")
    with Scene.open(scene) as opened:
        facts = collect_facts(opened, has_input=False)
    assert [row["name"] for row in facts.regions] == ["4", "2", "9"]
    assert "Labels are left out: labels.json: format None" in facts.regions_note


def test_a_scene_of_format_1_0_shows_its_own_numbers(tmp_path: Path) -> None:
    with Scene.open(write_tiny_scene(tmp_path / "s").path) as opened:
        facts = collect_facts(opened, has_input=False)
    assert [row["name"] for row in facts.regions] == ["0", "1", "2"]
    assert facts.region_columns == ("label",)
    assert "stable" not in facts.regions_note


def test_how_fine_the_surface_was_solved_is_said(tmp_path: Path) -> None:
    scene = write_tiny_scene(tmp_path / "s").path
    stages = [
        {"name": "clean", "counts": {"spacing_m": 1.537}},
        {"name": "reconstruct", "counts": {"cell_m": 1.5467}},
    ]
    (scene / "build.json").write_text(json.dumps({"stages": stages}))
    with Scene.open(scene) as opened:
        details = collect_facts(opened, has_input=False).internals
    assert {row["label"]: row["value"] for row in details}["reconstruction"] == (
        "cells of 1.55 m; a sample every 1.54 m"
    )


def test_noise_that_was_smoothed_is_said(tmp_path: Path) -> None:
    scene = write_tiny_scene(tmp_path / "s").path
    counts = {"spacing_m": 0.085, "noise_m": 0.1215, "cell_m": 0.123, "smoothing_m": 0.472}
    record = {"stages": [{"name": "reconstruct", "counts": counts}]}
    (scene / "build.json").write_text(json.dumps(record))
    with Scene.open(scene) as opened:
        details = collect_facts(opened, has_input=False).internals
    assert {row["label"]: row["value"] for row in details}["reconstruction"] == (
        "cells of 0.123 m; a sample every 0.085 m; noise of 0.12 m, smoothed over 0.47 m about "
        "each sample"
    )


def test_the_files_of_a_survey_are_listed_and_what_was_not_read(tmp_path: Path) -> None:
    scene = write_tiny_scene(tmp_path / "s").path
    record = {
        "inputs": [
            {"name": f"tile_{n}.laz", "bytes": 1000, "points": 10, "repeats": n} for n in range(30)
        ],
        "left_out": [
            {"name": "README.txt", "reason": "is no survey", "damaged": False},
            {"name": "tile_31.laz", "reason": "it is cut off", "damaged": True},
        ],
    }
    (scene / "build.json").write_text(json.dumps(record))
    with Scene.open(scene) as opened:
        details = {
            row["label"]: row["value"] for row in collect_facts(opened, has_input=False).details
        }
    assert details["input"].startswith(
        "30 files, 30 kB, 300 points (435 of them in several, taken once): tile_0.laz, tile_1"
    )
    assert details["input"].endswith("tile_19.laz and 10 more")
    assert details["damaged files, left out"] == "tile_31.laz (it is cut off)"
    assert details["files not read"] == "README.txt (is no survey)"


def test_an_extent_is_said_in_a_line_and_rubbish_is_not() -> None:
    extent = {"values": [1.5, 2.0, 3.0, 4.0], "points": 1200, "files": 0, "remarks": []}
    assert extent_line({"extent": extent}) == (
        "1.5 2 3 4 in the files' coordinates; 1,200 points lie outside it"
    )
    for rubbish in (None, [], {"values": 7}, "1 2 3 4"):
        assert extent_line({"extent": rubbish}) == ""


def test_regions_of_a_name_are_added_up() -> None:
    def row(label: str, area_m2: float, confidence: float | None = None, **more: float) -> dict:
        areas = {"surface_area_m2": area_m2, "plan_area_m2": area_m2 / 2}
        return {"label": label, **areas, "confidence": confidence, **more}

    rows = [
        row("ore", 30.0, 0.9, cut_m3=1.0, fill_m3=20.0, change_uncertainty_m3=0.5),
        row("road", 50.0, cut_m3=0.0, fill_m3=0.0),
        row("ore", 10.0, 0.5, cut_m3=2.0, fill_m3=0.0),
        row("", 110.0, cut_m3=0.0, fill_m3=0.0),
    ]
    columns, table = name_table(rows, SurveyUnit())
    assert columns == (
        "regions", "plan area m²", "surface area m²", "share", "cut m³", "fill m³", "± m³",
        "confidence",
    )  # fmt: skip
    assert table == (
        ("road", "1", "25", "50", "25.0 %", "0.0", "0.0", "0.0", ""),
        ("ore", "2", "20", "40", "20.0 %", "3.0", "20", "0.5", "0.80"),
        ("without a name", "1", "55", "110", "55.0 %", "0.0", "0.0", "0.0", ""),
    )
    assert name_table([row("", 1.0)], SurveyUnit()) == ((), ())


def test_the_report_says_how_a_scene_is_had_as_3d_tiles(tmp_path: Path) -> None:
    """The address and the command are those that there are; the place, where there is a CRS."""
    with Scene.open(write_tiny_scene(tmp_path / "s").path) as opened:
        details = {
            row["label"]: row["value"] for row in collect_facts(opened, has_input=False).details
        }
        manifest = opened.manifest
    utm = CrsInfo(name="WGS 84 / UTM zone 35S", wkt="", epsg=32735)
    placed = tiles_line(manifest.model_copy(update={"crs": utm}))
    assert placed.startswith("on its place on the Earth; /scenes/NAME/tileset.json of the service")
    assert placed.endswith("terraport export SCENE -o FILE.3tz")
    local = tiles_line(manifest.model_copy(update={"crs": None}))
    assert local.startswith("local (east, north, up): the survey states no coordinate reference")
    assert details["as 3D Tiles"] == tiles_line(manifest)
