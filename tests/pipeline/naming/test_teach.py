"""A few strokes, and all ground has its name: how well, how sure, and for the next survey too."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import laspy
import numpy as np
import pyogrio.raw
import pytest
import rasterio
import shapely
from pipeline.naming.named_ground import (
    ground_at,
    is_dark,
    line,
    square,
    write_geojson,
    write_named_ground,
)

from terraport_pipeline.errors import OptionError, PlanError
from terraport_pipeline.export.hand_on import ExportRequest, export_scene
from terraport_pipeline.naming import model_file
from terraport_pipeline.naming.drawings import Drawing
from terraport_pipeline.naming.model_file import read_model
from terraport_pipeline.naming.teacher import Teacher, stroke_areas
from terraport_pipeline.naming.teaching import Lesson, teach
from terraport_pipeline.progress import NullProgress
from terraport_store import change_labels, read_manifest, read_names, validate_scene

STROKES = [
    ("tailings", line((30, -40), (38, -42))),
    ("tailings", line((20, -90), (30, -92))),
    ("tailings", line((70, -95), (80, -95))),
    ("limestone", line((70, -20), (80, -25))),
    ("limestone", line((10, -10), (14, -16))),
    ("limestone", line((55, -70), (65, -70))),
]


@pytest.fixture
def strokes(tmp_path: Path) -> Path:
    return write_geojson(tmp_path / "strokes.geojson", STROKES)


def taught(scene: Path, strokes: Path | None, **options) -> list[str]:
    return teach(Lesson(scene, strokes, options.pop("model", None), **options), NullProgress())[0]


def accuracy(scene: Path) -> float:
    """Share of the area that has its name, in picks' own words."""
    ground = ground_at(scene)
    count = len(ground.document["regions"])
    dark = np.array([ground.names.label(region) == "tailings" for region in range(count)])
    right = dark[ground.region_of_face] == is_dark(ground.centres[:, 0], ground.centres[:, 2])
    return float(ground.area[right].sum() / ground.area.sum())


def test_strokes_name_all_ground_and_the_next_survey_needs_none(scene, strokes, tmp_path) -> None:
    change_labels(scene, {4: "an older word"})
    said = taught(scene, strokes, save_model=tmp_path / "pit.model")
    assert said[0].startswith("learned from 6 strokes, in squares of")
    assert accuracy(scene) > 0.98
    assert validate_scene(scene) == []
    names, facts = read_names(scene)
    rows = facts["regions"]
    # The disc and the strip of tailings are two regions of one name.
    assert sorted(names.label(row["id"]) for row in rows) == ["limestone", "tailings", "tailings"]
    for row in rows:
        assert row["class"] == names.label(row["id"])
        assert 0.7 < row["confidence"] <= 1.0
        assert row["place"]["radius_m"] >= 20.0
    # A copy of the survey has the names as classes, the user's own from 64 on.
    done = export_scene(scene, ExportRequest(tmp_path / "pit.las"))
    assert done.facts["class"] == "by name (64 limestone, 65 tailings)"
    points = laspy.read(tmp_path / "pit.las")
    east, north = np.array(points.x), np.array(points.y)
    dark = is_dark(east - 500_000.0, 6_000_000.0 - north)
    assert ((np.asarray(points.classification) == 65) == dark).mean() > 0.98
    (lookup,) = points.header.vlrs.get("ClassificationLookupVlr")
    assert lookup.lookups == {64: "limestone", 65: "tailings"}
    # The next survey: other noise, and 3 % brighter.
    after = write_named_ground(tmp_path / "june", seed=1, gain=1.03)
    said = taught(after, None, model=tmp_path / "pit.model")
    assert accuracy(after) > 0.97
    assert not any("learned" in text for text in said)


def test_the_same_strokes_give_the_same_model_and_regions(scene, strokes, tmp_path) -> None:
    files = [tmp_path / "a.model", tmp_path / "b.model"]
    for file in files:
        taught(scene, strokes, save_model=file, dry_run=True)
    assert files[0].read_bytes() == files[1].read_bytes()
    model = read_model(files[0])
    assert model.names == ("limestone", "tailings")
    assert model.attributes == ("grade",)
    version = read_manifest(scene).version
    with pytest.raises(OptionError, match="exists already"):
        taught(scene, strokes, save_model=files[0])
    assert read_manifest(scene).version == version


def test_features_are_kept_for_the_next_stroke(scene, strokes) -> None:
    _, teacher = teach(Lesson(scene, strokes, None), NullProgress())
    said, again = teach(Lesson(scene, strokes, None), NullProgress(), teacher)
    assert again.ground.version != teacher.ground.version
    assert again.features is teacher.features
    assert "3 regions, 3 of them with the stable id that they had" in said[-1]
    other = Teacher(again.ground, cell_m=3.0, before=teacher)
    assert other.features is not teacher.features


def test_where_it_is_unsure(scene, strokes, tmp_path) -> None:
    taught(scene, strokes, uncertainty=tmp_path / "u.tif", dry_run=True)
    with rasterio.open(tmp_path / "u.tif") as picture:
        doubt = picture.read(1)
        assert picture.crs.to_epsg() == 32633
        rows, columns = np.nonzero(doubt >= 0)
        x, y = picture.transform @ (columns + 0.5, rows + 0.5)
    known = doubt[rows, columns]
    assert known.max() <= 1.0
    x, z = x - 500_000.0, 6_000_000.0 - y
    # At the borders between both, and nowhere else.
    inside = [np.hypot(x - 35, z - 40) < 14, (z < 80) & (np.hypot(x - 35, z - 40) > 24)]
    border = np.abs(np.hypot(x - 35, z - 40) - 18) < 2
    assert known[border].mean() > 3 * max(known[where].mean() for where in inside)

    taught(scene, strokes, uncertainty=tmp_path / "u.geojson", dry_run=True)
    meta, _, geometry, columns = pyogrio.raw.read(tmp_path / "u.geojson")
    fields = dict(zip(meta["fields"], columns, strict=True))
    places = shapely.get_coordinates(shapely.from_wkb(geometry))
    assert 1 <= len(places) <= 20
    assert set(fields["likeliest"]) | set(fields["or"]) == {"limestone", "tailings"}
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    assert apart[~np.eye(len(places), dtype=bool)].min() > 10.0
    with pytest.raises(OptionError, match="ends with"):
        taught(scene, strokes, uncertainty=tmp_path / "u.png", dry_run=True)


def test_points_and_areas_are_strokes_too(scene, tmp_path) -> None:
    spot = {"type": "Point", "coordinates": [500_035.0, 5_999_960.0]}
    strokes = write_geojson(
        tmp_path / "s.geojson", [("tailings", spot), ("limestone", square(60, -60, 70, -50))]
    )
    taught(scene, strokes, stroke_width_m=8.0)
    ground = ground_at(scene)
    count = len(ground.document["regions"])
    dark = np.array([ground.names.label(region) == "tailings" for region in range(count)])
    x, z = ground.centres[:, 0], ground.centres[:, 2]
    assert dark[ground.region_of_face][np.hypot(x - 35, z - 40) < 4].all()
    assert not dark[ground.region_of_face][(np.abs(x - 65) < 5) & (np.abs(z - 55) < 5)].any()


@pytest.mark.parametrize(
    ("features", "said"),
    [
        (STROKES[:3], "strokes of 1 names, expected 2 to 64"),
        ([*STROKES, (None, STROKES[0][1])], "1 strokes without a name .* feature 7"),
        ([*STROKES, ("lake", line((300, 0), (310, 0)))], "no stroke of 'lake' is on the ground"),
    ],
)
def test_strokes_that_teach_nothing_are_refused(scene, tmp_path, features, said) -> None:
    version = read_manifest(scene).version
    with pytest.raises((OptionError, PlanError), match=said):
        taught(scene, write_geojson(tmp_path / "s.geojson", features))
    assert read_manifest(scene).version == version


def test_options_that_contradict_each_other(scene, strokes, tmp_path) -> None:
    wrong = [
        ({"model": tmp_path / "m"}, "one of the two"),
        ({"cell_m": -1.0}, "--cell-m -1.0"),
        ({"least_m2": float("nan")}, "--least-m2"),
        ({"strokes": None, "model": tmp_path / "m", "cell_m": 1.0}, "--cell-m is of strokes"),
    ]
    for options, said in wrong:
        with pytest.raises(OptionError, match=said):
            Lesson(**{"scene": scene, "strokes": strokes, "model": None, **options})


def test_squares_have_a_bound(scene) -> None:
    with pytest.raises(OptionError, match=r"squares of .* expected at most .* larger --cell-m"):
        _ = Teacher(ground_at(scene), cell_m=0.001).units


def test_a_survey_without_the_models_attribute_is_told(scene, strokes, tmp_path) -> None:
    taught(scene, strokes, save_model=tmp_path / "m", dry_run=True)
    model = read_model(tmp_path / "m")
    ground = ground_at(scene)
    ground.mesh.attributes.clear()
    with pytest.raises(OptionError, match="'grade', which this survey does not have"):
        Teacher(ground, cell_m=model.cell_m, attributes=model.attributes)


def damaged(path: Path, entry: str, change) -> Path:
    """The model with one entry changed."""
    out = path.with_suffix(".damaged")
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            new.writestr(name, change(data) if name == entry else data)
    return out


def array_entry(change):
    import io

    def changed(data: bytes) -> bytes:
        array = np.load(io.BytesIO(data))
        out = io.BytesIO()
        np.save(out, change(array))
        return out.getvalue()

    return changed


def loops(left: np.ndarray) -> np.ndarray:
    left[0] = 0
    return left


def test_a_model_of_a_stranger_is_checked_number_by_number(
    scene, strokes, tmp_path, monkeypatch
) -> None:
    path = tmp_path / "m.model"
    taught(scene, strokes, save_model=path, dry_run=True)

    def document(**keys):
        return lambda data: json.dumps({**json.loads(data), **keys}).encode()

    wrong = [
        ("left.npy", array_entry(loops), "child that does not come after"),
        ("feature.npy", array_entry(lambda a: np.where(a >= 0, 999, a)), "feature beyond"),
        ("threshold.npy", array_entry(lambda a: a * np.nan), "threshold that is no number"),
        ("share.npy", array_entry(lambda a: a * 2), "do not add up to 1"),
        ("share.npy", array_entry(lambda a: a[:-1]), "expected equally many"),
        ("roots.npy", array_entry(lambda a: a[::-1].copy()), "roots that do not ascend"),
        ("middle.npy", array_entry(lambda a: a[1:]), "middle or spread that are not"),
        ("spread.npy", array_entry(lambda a: a * np.nan), "middle or spread that are not"),
        ("left.npy", array_entry(lambda a: a.astype(np.int64)), "an array of int64"),
        ("left.npy", array_entry(lambda a: np.array([{}], object)), "damaged, or no model"),
        ("model.json", document(format="x"), "no terraport-ground-model"),
        ("model.json", document(format_version="2.0"), "expected 1.x"),
        ("model.json", document(names=[]), "no lists of texts"),
        ("model.json", document(names=["a\n", "b"]), "control character"),
        ("model.json", document(cell_m=0), "cell_m 0"),
        ("model.json", document(features=["hue"]), "other features than this release"),
        ("model.json", lambda data: b"[" * 100_000, "damaged, or no model"),
    ]
    for entry, change, said in wrong:
        with pytest.raises(PlanError, match=said):
            read_model(damaged(path, entry, change))
    (tmp_path / "none").write_bytes(b"pickle")
    with pytest.raises(PlanError, match="damaged, or no model"):
        read_model(tmp_path / "none")
    monkeypatch.setattr(model_file, "MAX_MODEL_BYTES", 1000)
    with pytest.raises(PlanError, match="bytes unpacked, expected at most 1,000"):
        read_model(path)


def test_the_arrays_say_what_the_forest_says(scene) -> None:
    from sklearn.ensemble import ExtraTreesClassifier

    teacher = Teacher(ground_at(scene), threads=2)
    shapes = [
        Drawing(n, name, shapely.LineString([(x, y), (x + 8, y + 2)]))
        for n, (name, x, y) in enumerate(
            [("a", 30, 40), ("b", 70, 20), ("c", 20, 92), ("b", 10, 10)]
        )
    ]
    model, counts = teacher.learn(stroke_areas(shapes, 2.0))
    assert set(counts) == {"a", "b", "c"}
    votes = model.forest.predict(teacher.features, threads=2)
    assert votes.sum(axis=1) == pytest.approx(1.0, abs=1e-4)
    # Grown once more by the library itself.
    finder = teacher._finder
    rows, kinds = [], []
    for kind, name in enumerate(model.names):
        units = np.unique(
            np.concatenate(
                [
                    teacher.units.of_face[finder.inside(d.shape)]
                    for d in stroke_areas(shapes, 2.0)
                    if d.name == name
                ]
            )
        )
        rows.append(teacher.features[units])
        kinds.append(np.full(len(units), kind))
    grown = ExtraTreesClassifier(
        100, min_samples_leaf=2, class_weight="balanced", random_state=1
    ).fit(np.concatenate(rows), np.concatenate(kinds))
    assert votes == pytest.approx(grown.predict_proba(teacher.features), abs=1e-5)
