"""Regions along what the mine has drawn: which face, which name, and what stays as it is."""

from __future__ import annotations

import json
import re
import shutil
from itertools import pairwise
from pathlib import Path

import ezdxf
import laspy
import numpy as np
import pyogrio.raw
import pytest
from pipeline.naming.named_ground import (
    EAST,
    NORTH,
    ground_at,
    line,
    payloads_of,
    plan_at,
    square,
    write_geojson,
)
from pyproj import Transformer

from terraport_pipeline.errors import OptionError, PlanError
from terraport_pipeline.export.hand_on import ExportRequest, export_scene
from terraport_pipeline.naming.plan import label_by_plan
from terraport_pipeline.progress import NullProgress
from terraport_store import SceneBusyError, change_labels, read_manifest, read_names, validate_scene
from terraport_store.publishing import PublishLock

PIT, PILE = square(10, -60, 70, -10), square(30, -50, 45, -35)


def label(scene: Path, plan: Path, **options) -> list[str]:
    return label_by_plan(scene, plan, NullProgress(), **options)


def names_by_face(scene: Path) -> np.ndarray:
    ground = ground_at(scene)
    count = len(ground.document["regions"])
    names = np.array([ground.names.label(region) or "" for region in range(count)])
    return names[ground.region_of_face]


def within(ground, x0, y0, x1, y1) -> np.ndarray:
    x, y = plan_at(ground)
    return (x > x0) & (x < x1) & (y > y0) & (y < y1)


def test_faces_go_by_their_centre_and_of_two_areas_to_the_smaller(scene, tmp_path) -> None:
    before, payloads = ground_at(scene), payloads_of(scene)
    # The pit comes last in the file, and is not drawn over the pile in it.
    plan = write_geojson(tmp_path / "p.geojson", [("pile", PILE), ("pit", PIT)])
    said = "\n".join(label(scene, plan))
    assert "2 outlines" in said
    assert re.search(r"2[23]\d m² lie in several outlines and went to the smallest", said)
    assert validate_scene(scene) == []
    ground, names = ground_at(scene), names_by_face(scene)
    pile, pit = within(ground, 30, -50, 45, -35), within(ground, 10, -60, 70, -10)
    assert (names[pile] == "pile").all()
    assert (names[pit & ~pile] == "pit").all()
    assert (names[~pit] == "").all()
    # What is not cut stays: its number, its stable id, and every byte of its segments.
    facts = ground.document
    assert [facts["regions"][n]["stable_id"] for n in (0, 1)] == [4, 7]
    assert sorted(row["stable_id"] for row in facts["regions"]) == [4, 7, 9, 10]
    assert facts["next_stable_id"] == 11
    after = payloads_of(scene)
    touched = np.zeros(len(payloads), bool)
    inside = within(before, 10, -60, 70, -10)
    touched[before.segment_of_face[inside]] = True
    same = np.array([a == b for a, b in zip(payloads, after, strict=True)])
    assert (same == ~touched).all()
    assert f"{touched.sum()} of 64 segments are loaded again" in said
    # Facts are measured anew where the ground of a region changed.
    rows = {row["stable_id"]: row for row in facts["regions"]}
    assert rows[9]["plan_area_m2"] + rows[10]["plan_area_m2"] == pytest.approx(3000, rel=0.01)
    assert {rows[9]["label"], rows[10]["label"]} == {"pile", "pit"}


def test_geometry_and_colours_come_back_exactly(scene, tmp_path) -> None:
    before = ground_at(scene)
    label(scene, write_geojson(tmp_path / "p.geojson", [("pile", PILE)]))
    after = ground_at(scene)

    def faces(ground):
        mesh = ground.mesh
        grade = mesh.attributes["grade"][:, None]
        rows = np.concatenate([mesh.vertices, mesh.colours, grade], axis=1).round(5)
        order = np.lexsort(rows.T)
        rank = np.argsort(order)
        return rows[order], {tuple(sorted(face)) for face in rank[mesh.faces].tolist()}

    (rows, corners), (rows_after, corners_after) = faces(before), faces(after)
    assert (rows == rows_after).all()
    assert corners == corners_after


def test_a_plan_in_degrees_cuts_the_same_as_one_in_the_surveys_crs(scene, tmp_path) -> None:
    other = shutil.copytree(scene, tmp_path / "other")
    label(scene, write_geojson(tmp_path / "p.geojson", [("pit", PIT)]))
    to_degrees = Transformer.from_crs(32633, 4326, always_xy=True)
    # Many corners: a straight line in one CRS is none in the other.
    ring = np.array(PIT["coordinates"][0])
    fine = np.concatenate([np.linspace(a, b, 50, endpoint=False) for a, b in pairwise(ring)])
    degrees = np.stack(to_degrees.transform(*fine.T), axis=1).tolist()
    pit = {"type": "Polygon", "coordinates": [[*degrees, degrees[0]]]}
    label(other, write_geojson(tmp_path / "d.geojson", [("pit", pit)], epsg=None))
    assert (names_by_face(scene) == "pit").sum() == pytest.approx(
        (names_by_face(Path(other)) == "pit").sum(), abs=2
    )


def test_a_centre_line_needs_a_width_and_gets_it(scene, tmp_path) -> None:
    road = line((5, -5), (95, -95))
    plan = write_geojson(tmp_path / "roads.geojson", [("haul road", road)])
    version = read_manifest(scene).version
    with pytest.raises(PlanError, match=r"open lines .* add --buffer-m"):
        label(scene, plan)
    with pytest.raises(OptionError, match="--buffer-m -1"):
        label(scene, plan, buffer_m=-1.0)
    assert read_manifest(scene).version == version
    label(scene, plan, buffer_m=4.0)
    ground = ground_at(scene)
    x, y = plan_at(ground)
    along, across = (x - y) / 2**0.5, np.abs(x + y) / 2**0.5
    far = (along < 5 * 2**0.5) | (along > 95 * 2**0.5)
    on_road = names_by_face(scene) == "haul road"
    assert (on_road[~far] == (across[~far] < 4.0)).mean() > 0.9999


def test_a_drawing_says_no_crs_and_closed_lines_are_outlines(scene, tmp_path) -> None:
    drawing = ezdxf.new()
    drawing.layers.add("STOCKPILES")
    ring = [(EAST + x, NORTH + y) for x, y in ((30, -50), (45, -50), (45, -35), (30, -35))]
    space = drawing.modelspace()
    space.add_lwpolyline(ring, close=True, dxfattribs={"layer": "STOCKPILES"})
    space.add_text("no outline", dxfattribs={"insert": ring[0]})
    drawing.saveas(tmp_path / "plan.dxf")
    with pytest.raises(PlanError, match=r"does not say which .* add --crs EPSG"):
        label(scene, tmp_path / "plan.dxf")
    with pytest.raises(OptionError, match="--crs nowhere"):
        label(scene, tmp_path / "plan.dxf", crs="nowhere")
    said = label(scene, tmp_path / "plan.dxf", crs="EPSG:32633")
    assert "left out: 1 points and texts" in said
    names = names_by_face(scene)
    assert (names == "STOCKPILES").sum() == within(ground_at(scene), 30, -50, 45, -35).sum()


def test_what_lies_outside_is_said_and_changes_nothing(scene, tmp_path) -> None:
    version = read_manifest(scene).version
    away = square(900, 900, 950, 950)
    with pytest.raises(PlanError, match=r"nothing of the scene .* 900 to 950 m east"):
        label(scene, write_geojson(tmp_path / "a.geojson", [("away", away)]))
    no_crs = write_geojson(tmp_path / "n.geojson", [("pit", PIT)], epsg=None)
    with pytest.raises(PlanError, match="in degrees, which a GeoJSON without"):
        label(scene, no_crs)
    assert read_manifest(scene).version == version
    said = label(scene, write_geojson(tmp_path / "b.geojson", [("away", away), ("pit", PIT)]))
    assert any("1 outlines got no ground" in text and "'away'" in text for text in said)
    assert label(scene, no_crs, crs="EPSG:32633")[1].startswith("3 regions, 3 of them with")


@pytest.mark.parametrize(
    ("features", "options", "said"),
    [
        ([], {}, "no feature in it"),
        ([("a\x07b", PIT)], {}, "feature 1: a label with the control character"),
        ([("pit", PIT)], {"name_field": "title"}, "properties 'name', expected 'title'"),
        ([("pit", PIT)], {"layer": "roads"}, "expected 'roads' among them"),
        ([("x", {"type": "Point", "coordinates": [EAST, NORTH]})], {}, "1 points and no outline"),
    ],
)
def test_what_cannot_be_used_is_said(scene, tmp_path, features, options, said) -> None:
    with pytest.raises(PlanError, match=said):
        label(scene, write_geojson(tmp_path / "p.geojson", features), **options)


def test_no_plan_at_all(scene, tmp_path) -> None:
    with pytest.raises(PlanError, match="no such file"):
        label(scene, tmp_path / "none.shp")
    (tmp_path / "b.gpkg").write_bytes(b"no database")
    with pytest.raises(PlanError, match="GDAL cannot read it"):
        label(scene, tmp_path / "b.gpkg")


def test_who_publishes_meanwhile_is_waited_for(scene, tmp_path) -> None:
    plan = write_geojson(tmp_path / "p.geojson", [("pit", PIT)])
    lock = PublishLock(scene)
    try:
        with pytest.raises(SceneBusyError):
            label(scene, plan)
    finally:
        lock.release()
    assert label(scene, plan)


def test_what_is_left_of_a_named_region_keeps_its_name(scene, tmp_path) -> None:
    change_labels(scene, {4: "ground", 7: "bench"})
    # Most of region 4 is drawn over: the rest gets another number, and is still the ground.
    most = square(-1, -101, 58, -3)
    label(scene, write_geojson(tmp_path / "p.geojson", [("floor", most)]))
    names = read_names(scene)[0]
    assert sorted(filter(None, map(names.label, range(3)))) == ["bench", "floor", "ground"]
    assert names.labels[4] == "floor"  # by the rule of intersection over union


@pytest.mark.parametrize("ending", ["geojson", "gpkg", "shp", "dxf"])
def test_what_is_given_back_makes_the_same_regions(published, scene, tmp_path, ending) -> None:
    features = [("pile", PILE), ("pit", PIT), ("road", square(72, -98, 75, -2))]
    label(scene, write_geojson(tmp_path / "p.geojson", features))
    path = tmp_path / f"regions.{ending}"
    done = export_scene(scene, ExportRequest(path, "regions"))
    assert done.facts == {"regions": "5", "with a name": "3"}
    other = Path(shutil.copytree(published, tmp_path / "other"))
    crs = "EPSG:32633" if ending == "dxf" else None
    label(other, path, crs=crs)
    ground, again = ground_at(scene), ground_at(other)

    def pieces(one):
        mesh = one.mesh
        order = np.lexsort(mesh.vertices[mesh.faces].mean(axis=1).T)
        _, named = np.unique(one.region_of_face[order], return_inverse=True)
        return named

    pairs = np.unique(np.stack([pieces(ground), pieces(again)]), axis=1)
    assert pairs.shape[1] == 5
    mine = set(names_by_face(scene)) - {""}
    assert mine <= set(names_by_face(other))
    # On the scene itself: nothing is cut, and no client loads anything.
    said = label(scene, path, crs=crs)
    assert "5 regions, 5 of them with the stable id that they had; 0 of 64" in said[1]


def test_a_hole_is_none_of_the_region_and_facts_are_written(scene, tmp_path) -> None:
    label(scene, write_geojson(tmp_path / "p.geojson", [("pile", PILE), ("pit", PIT)]))
    path = tmp_path / "r.gpkg"
    export_scene(scene, ExportRequest(path, "regions", regions=("pit",)))
    meta, _, geometry, columns = pyogrio.raw.read(path)
    row = dict(zip(meta["fields"], (column[0] for column in columns), strict=True))
    assert row["name"] == "pit"
    assert row["surface_area_m2"] > 60 * 50 - 15 * 15
    assert row["colour"].startswith("#")
    assert {"region", "slope_deg", "rough_m", "lowest_m", "highest_m"} <= set(row)
    import shapely

    shape = shapely.from_wkb(geometry[0])
    assert shape.area == pytest.approx(60 * 50 - 15 * 15, rel=0.01)
    assert not shape.contains(shapely.Point(EAST + 37, NORTH - 42))


def feature(geometry, **properties):
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def written(path: Path, features) -> Path:
    """GeoJSON of features as they stand, in degrees or with `--crs`."""
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


PIT_RING = PIT["coordinates"][0]
OPEN_RING = {"type": "Polygon", "coordinates": [PIT["coordinates"][0][:-1]]}
FAR = {"type": "Polygon", "coordinates": [[*PIT["coordinates"][0][:-1], (1e308, NORTH)]]}
BOW = {
    "type": "Polygon",
    "coordinates": [
        [(EAST + x, NORTH + y) for x, y in ((10, -60), (70, -10), (70, -60), (10, -10))]
    ],
}


@pytest.mark.parametrize(
    ("geometry", "name", "called", "share"),
    [
        (OPEN_RING, "pit", "pit", 1.0),  # closed
        (PIT, 7, "7", 1.0),
        (PIT, 8.0, "8", 1.0),
        (PIT, 8.25, "8.25", 1.0),
        (PIT, ["pit", "north"], "pit, north", 1.0),
        (BOW, "bow", "bow", 0.5),  # both of its triangles
        (
            {"type": "MultiPolygon", "coordinates": [[PIT_RING, PILE["coordinates"][0]]]},
            "holed", "holed", 1.0 - 225 / 3000,
        ),
        (
            {"type": "Polygon", "coordinates": [[(*at, 250.0) for at in PIT["coordinates"][0]]]},
            "high", "high", 1.0,
        ),
    ],
)  # fmt: skip
def test_odd_outlines_are_what_a_person_means(
    scene, tmp_path, geometry, name, called, share
) -> None:
    label(
        scene,
        written(tmp_path / "odd.geojson", [feature(geometry, name=name)]),
        crs="EPSG:32633",
    )
    names, ground = names_by_face(scene), ground_at(scene)
    inside = within(ground, 10, -60, 70, -10)
    assert set(names[~inside]) == {""}
    of_name = np.array([one == called for one in names[inside]])
    assert of_name.mean() == pytest.approx(share, abs=0.02)


def test_a_corner_that_is_nowhere_is_refused(scene, tmp_path) -> None:
    far = written(tmp_path / "far.geojson", [feature(PILE, name="a"), feature(FAR, name="b")])
    with pytest.raises(PlanError, match="feature 2 has a corner that is no number, or more than"):
        label(scene, far, crs="EPSG:32633")


def test_outlines_with_an_empty_name_are_told(scene, tmp_path) -> None:
    plan = written(
        tmp_path / "e.geojson",
        [feature(PIT, name="pit"), feature(PILE, name="  "), feature(None, name="lost")],
    )
    said = label(scene, plan, crs="EPSG:32633")
    assert any("1 of 2 outlines are empty in 'name'" in text for text in said)
    assert said[-1] == "left out: 1 features without geometry"


def test_a_copy_of_the_survey_has_what_ground_is_called_as_classes(scene, tmp_path) -> None:
    plan = write_geojson(tmp_path / "p.geojson", [("Water", PIT), ("pile", PILE)])
    label(scene, plan)
    export_scene(scene, ExportRequest(tmp_path / "pit.las"))
    points = laspy.read(tmp_path / "pit.las")
    x, y = np.asarray(points.x) - EAST, np.asarray(points.y) - NORTH
    in_pit = (x > 10) & (x < 70) & (y > -60) & (y < -10)
    in_pile = (x > 30) & (x < 45) & (y > -50) & (y < -35)
    expected = np.where(in_pile, 64, np.where(in_pit, 9, 0))  # 9 is LAS's water
    assert (np.asarray(points.classification) == expected).mean() > 0.99
    (lookup,) = points.header.vlrs.get("ClassificationLookupVlr")
    assert lookup.lookups == {9: "Water", 64: "pile"}
