from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terraport.frames import to_scene
from terraport_pipeline.errors import (
    BuildLockedError,
    OptionError,
    ResourceError,
    SurveyError,
    WorkDirectoryError,
)
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.published.scene_model import load_scene_model
from terraport_pipeline.published.work_directory import default_work_directory
from terraport_pipeline.report.facts import collect_facts
from terraport_pipeline.survey_statement import SurveyStatement
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_pipeline.workflow.scene_lock import scene_locked
from terraport_pipeline.workflow.workdir import file_digest
from terraport_store.manifest import SurveyUnits
from terraport_store.reader import Scene
from terraport_store.validate import validate_scene

RECONSTRUCT = reconstruct.Options(base_faces=800)
SEGMENT = segment.Options(min_faces=150, max_faces=900)

KEPT = {
    "read": ["read"],
    "clean": ["clean"],
    "reconstruct": [
        "measure_survey", "frame", "plan", "partition", "solve-00000", "edges", "join",
        "weak-00000", "look-00000", "settle", "tile-00000", "base-tile-00000", "base",
    ],
    "segment": [
        "segment-measure-00000", "segment-scale", "segment-units-00000", "segment-regions",
        "segment-numbers", "segment-samples", "segment-cut-00000", "cover-scale",
        "segment-cover-00000", "segment", "plan-regions",
    ],
    "base_atlas": ["base_atlas"],
    "pack": ["pack-scales", "pack-tile-00000", "pack"],
}  # fmt: skip
"""Names in the work directory of what is reported as one stage."""

STAGES = list(KEPT)


def options_for(survey: Path, scene: Path, **more: Any) -> BuildOptions:
    return BuildOptions(survey, scene, reconstruct=RECONSTRUCT, segment=SEGMENT, **more)


def published_bytes(scene: Path) -> dict[str, bytes]:
    """Everything that is part of the published version."""
    with Scene.open(scene) as opened:
        files = {file.path for file in opened.manifest.files.values()}
    return {path: (scene / path).read_bytes() for path in ("scene.json", *files)}


class Stop(NullProgress):
    """Presses Ctrl-C when a step begins."""

    def __init__(self, step: str) -> None:
        self.step = step
        self.seen: list[str] = []

    def start(self, stage: str, total: float | None, unit: str) -> None:
        self.seen.append(stage)
        if stage == self.step:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory, make_hill_text: str) -> Path:
    """A survey and its scene, built once; never modified."""
    folder = tmp_path_factory.mktemp("built")
    (folder / "hill.xyz").write_text(make_hill_text, encoding="ascii")
    report = build(options_for(folder / "hill.xyz", folder / "hill", threads=1))
    assert report.published
    return folder


@pytest.fixture
def copy(built: Path, tmp_path: Path) -> Path:
    """A copy of the folder to harm."""
    target = tmp_path / "copy"
    shutil.copytree(built, target)
    return target


def test_a_survey_in_feet_says_so_and_a_statement_makes_another_scene(built: Path) -> None:
    statement = SurveyStatement(units="us-ft", height_units="m")
    survey, scene = built / "hill.xyz", built / "feet" / "hill"
    report = build(options_for(survey, scene, statement=statement))
    rows = np.loadtxt(survey, skiprows=1, delimiter=None, usecols=(0, 1, 2), ndmin=2)
    with Scene.open(scene) as opened:
        manifest = opened.manifest
        facts = collect_facts(opened, has_input=False)
    assert report.published
    assert manifest.survey_units == SurveyUnits(horizontal_m=1200 / 3937, height_m=1.0)
    assert manifest.build.options["statement"] == {"units": "us-ft", "height_units": "m"}
    assert any("converted to metres" in text for text in manifest.build.choices)
    assert not any("converted to metres" in text for text in manifest.build.warnings)
    # There and back: the scene's middle is that of the file's own numbers.
    low, high = rows.min(axis=0), rows.max(axis=0)
    units = manifest.survey_units.model_dump()
    x, _, z = to_scene(tuple((low + high) / 2), manifest.origin, units)
    assert abs(x) < 1
    assert abs(z) < 1
    [own] = [row["value"] for row in facts.details if row["label"] == "box of the scene"]
    assert f"E {low[0]:,.0f}"[:-3] in own
    shutil.rmtree(scene.parent)


def test_the_scene_is_valid_and_nothing_lies_beside_it(built: Path) -> None:
    assert validate_scene(built / "hill") == []
    assert sorted(path.name for path in built.iterdir()) == [".hill.work", "hill", "hill.xyz"]
    left = sorted(path.name for path in (built / ".hill.work").iterdir())
    results = [name for names in KEPT.values() for name in names]
    assert left == sorted([".terraport-work", "published", *results])


def test_a_known_point_of_the_survey_is_found_in_the_scene(built: Path) -> None:
    """UTM in float64 to a streamed vertex: within the noise of the samples and a grid step."""
    rows = (built / "hill.xyz").read_text().splitlines()[1:]
    survey = np.array([[float(v) for v in row.split()] for row in rows])
    with Scene.open(built / "hill") as opened:
        manifest = opened.manifest
        meshes = [opened.mesh(i) for i in range(manifest.counts.segments)]
    vertices = np.concatenate([mesh.positions for mesh in meshes]).astype(np.float64)
    grade = np.concatenate([mesh.attributes["grade"] for mesh in meshes])
    origin = np.array(manifest.origin)
    crs = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1) + origin
    middle = np.abs(survey[:, :2] - np.median(survey[:, :2], axis=0)).max(axis=1) < 15
    for point in survey[middle][::40]:
        distance_m = np.linalg.norm(crs - point[:3], axis=1)
        nearest = int(distance_m.argmin())
        assert distance_m[nearest] < 0.7  # the spacing is 0.73 m
        assert abs(grade[nearest] - point[6]) < 0.03


def test_one_and_two_threads_publish_the_same_bytes(built: Path, tmp_path: Path) -> None:
    scene = tmp_path / "hill"
    build(options_for(built / "hill.xyz", scene, threads=2))
    assert published_bytes(scene) == published_bytes(built / "hill")


def test_built_again_everything_is_taken_up(copy: Path) -> None:
    before = published_bytes(copy / "hill")
    report = build(options_for(copy / "hill.xyz", copy / "hill"))
    assert [stage.taken_up for stage in report.stages] == [True] * len(STAGES)
    assert not report.published
    assert published_bytes(copy / "hill") == before


def test_no_resume_does_all_again_and_publishes_the_same(copy: Path) -> None:
    before = published_bytes(copy / "hill")
    report = build(options_for(copy / "hill.xyz", copy / "hill", resume=False))
    assert [stage.taken_up for stage in report.stages] == [False] * len(STAGES)
    assert published_bytes(copy / "hill") == before


@pytest.mark.parametrize(
    ("change", "first"),
    [
        ({"segment": replace(SEGMENT, max_faces=500)}, "segment"),
        ({"reconstruct": replace(RECONSTRUCT, base_faces=500)}, "reconstruct"),
        ({"name": "Another"}, "pack"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_changed_option_does_only_what_it_must(
    copy: Path, change: Mapping[str, Any], first: str
) -> None:
    report = build(replace(options_for(copy / "hill.xyz", copy / "hill"), **change))
    expected = STAGES.index(first)
    assert [stage.taken_up for stage in report.stages] == [i < expected for i in range(len(STAGES))]
    assert report.published
    assert validate_scene(copy / "hill") == []


def test_a_changed_survey_is_noticed_and_a_touched_one_is_not(copy: Path) -> None:
    survey = copy / "hill.xyz"
    survey.touch()
    assert not build(options_for(survey, copy / "hill")).published
    survey.write_text(survey.read_text().replace(" 200 60 40 ", " 40 60 200 "), encoding="ascii")
    stop = Stop("clean: copies")  # so the survey was read again
    with pytest.raises(KeyboardInterrupt):
        build(options_for(survey, copy / "hill"), stop)


def test_a_scene_that_is_gone_is_published_from_the_work_directory(copy: Path) -> None:
    before = published_bytes(copy / "hill")
    shutil.rmtree(copy / "hill")
    report = build(options_for(copy / "hill.xyz", copy / "hill"))
    assert [stage.taken_up for stage in report.stages] == [True] * (len(STAGES) - 1) + [False]
    assert published_bytes(copy / "hill") == before


def test_the_bases_image_is_at_hand_where_some_segments_are_read_alone(built: Path) -> None:
    with Scene.open(built / "hill") as scene:
        model = load_scene_model(scene, segments=np.array([1]))
        assert model.textures is not None
        assert set(model.textures.base.image_of_face.tolist()) == {len(scene.index)}
        width, height = model.textures.base.images.size(len(scene.index))
        assert model.textures.base.images.get(len(scene.index), 0).shape == (height, width, 3)


@pytest.mark.parametrize(
    ("stage", "step"),
    [
        ("reconstruct", "tiles: solve 1, 1 at a time"),
        ("segment", "segment: cover"),
        ("pack", "pack: segments"),
        ("pack", "pack: base"),
    ],
)
def test_ctrl_c_then_the_same_command(copy: Path, stage: str, step: str) -> None:
    """The old scene stands until the new one is whole; what was done is not done again."""
    done = STAGES.index(stage)
    for later in STAGES[done:]:
        for name in KEPT[later]:
            shutil.rmtree(copy / ".hill.work" / name)
    before = published_bytes(copy / "hill")
    options = options_for(copy / "hill.xyz", copy / "hill", name="Renewed")
    stop = Stop(step)
    with pytest.raises(KeyboardInterrupt):
        build(options, stop)
    assert stop.seen[-1] == step
    assert published_bytes(copy / "hill") == before
    assert not [path for path in (copy / ".hill.work").iterdir() if path.suffix == ".tmp"]
    assert not (copy / ".hill.lock").exists()
    report = build(options)
    assert [stage.taken_up for stage in report.stages] == [i < done for i in range(len(STAGES))]
    assert report.published
    assert validate_scene(copy / "hill") == []
    with Scene.open(copy / "hill") as opened:
        assert opened.manifest.name == "Renewed"


def test_the_report_has_times_and_the_scene_has_none(built: Path) -> None:
    document = json.loads((built / "hill" / "build.json").read_text())
    assert [stage["name"] for stage in document["stages"]] == STAGES
    assert all(stage["seconds"] > 0 and stage["peak_bytes"] > 0 for stage in document["stages"])
    manifest = json.loads((built / "hill" / "scene.json").read_text())
    assert document["version"] == manifest["version"]
    text = json.dumps(manifest)
    assert "seconds" not in text
    assert str(built) not in text
    assert manifest["build"]["options"]["reconstruct"]["base_faces"] == 800
    # Which points stands in the manifest, which files beside it.
    assert manifest["build"]["input"]["name"] == "survey"
    [file] = document["inputs"]
    survey = built / "hill.xyz"
    assert file == {
        "name": "hill.xyz",
        "format": "xyz",
        "bytes": survey.stat().st_size,
        "xxh3": file_digest(survey),
        "points": 3000,
        "repeats": 0,
    }
    assert document["left_out"] == []


def test_the_table_names_every_stage(copy: Path) -> None:
    report = build(options_for(copy / "hill.xyz", copy / "hill"))
    assert list(report.table().columns[0].cells) == [*STAGES, "all"]
    assert "taken up" in list(report.table().columns[1].cells)


# Bad input: a clear error, and nothing half-written.


def flat(rows: list[str]) -> str:
    return "\n".join(["x y z", *rows, ""])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        (flat(["1 2 3", "4 5 7", "7 8 1"]), "3 different points"),
        (flat(["5 5 5"] * 400), "1 different points"),
        (flat([f"{i % 20} {i // 20} 4" for i in range(400)]), "lie on one plane"),
        (flat([f"{i} {2 * i} {3 * i}" for i in range(400)]), "lie on one line"),
    ],
    ids=["empty", "three points", "copies", "plane", "line"],
)
def test_bad_surveys_leave_nothing(tmp_path: Path, text: str, message: str) -> None:
    survey = tmp_path / "bad.xyz"
    survey.write_text(text, encoding="ascii")
    with pytest.raises(SurveyError, match=message):
        build(options_for(survey, tmp_path / "scene"))
    assert not (tmp_path / "scene").exists()
    assert not (tmp_path / ".scene.lock").exists()


def test_a_bad_survey_leaves_the_old_scene(copy: Path) -> None:
    before = published_bytes(copy / "hill")
    (copy / "hill.xyz").write_text(flat(["1 2 3"]), encoding="ascii")
    with pytest.raises(SurveyError):
        build(options_for(copy / "hill.xyz", copy / "hill"))
    assert published_bytes(copy / "hill") == before


def test_paths_that_cannot_be(tmp_path: Path, hill_file: Path) -> None:
    with pytest.raises(SurveyError, match="no such file"):
        build(options_for(tmp_path / "none.laz", tmp_path / "scene"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(SurveyError, match="empty is empty"):
        build(options_for(tmp_path / "empty", tmp_path / "scene"))
    with pytest.raises(OptionError, match="for the scene to stand in"):
        build(options_for(hill_file, hill_file / "scene"))
    with pytest.raises(OptionError, match="is a file"):
        build(options_for(hill_file, hill_file))
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "1.jpg").touch()
    with pytest.raises(OptionError, match=r"holds other files \(1\.jpg\)"):
        build(options_for(hill_file, tmp_path / "photos"))
    with pytest.raises(WorkDirectoryError, match="holds files that no build wrote"):
        build(options_for(hill_file, tmp_path / "scene", work=tmp_path / "photos"))
    assert not (tmp_path / "scene").exists()


@pytest.mark.parametrize("more", [{"threads": 0}, {"max_points": 10}, {"max_memory_bytes": 5}])
def test_options_out_of_range(hill_file: Path, tmp_path: Path, more: dict[str, int]) -> None:
    with pytest.raises(OptionError, match="expected"):
        build(options_for(hill_file, tmp_path / "scene", **more))
    assert not default_work_directory(tmp_path / "scene").exists()


def test_options_of_the_last_stage_are_refused_before_the_first() -> None:
    with pytest.raises(OptionError, match="1 to 200"):
        BuildOptions(Path("a.laz"), Path("b"), name="")


def test_an_attribute_that_is_not_there_is_refused_before_the_reconstruction(
    hill_file: Path, tmp_path: Path
) -> None:
    bad_options = replace(
        options_for(hill_file, tmp_path / "hill"), segment=replace(SEGMENT, segment_by="grad")
    )
    watcher = Stop("none of them")
    with pytest.raises(OptionError, match="segments by 'grad'; this survey has colour, shape"):
        build(bad_options, progress=watcher)
    assert not any(step.startswith("measure") for step in watcher.seen)
    assert any(step.startswith("clean") for step in watcher.seen)
    assert not (tmp_path / "hill").exists()


def test_too_little_memory_is_said(hill_file: Path, tmp_path: Path) -> None:
    with pytest.raises(ResourceError, match="--max-memory"):
        build(options_for(hill_file, tmp_path / "scene", max_memory_bytes=2**28))
    assert not (tmp_path / "scene").exists()


def test_two_builds_of_one_scene(hill_file: Path, tmp_path: Path) -> None:
    with scene_locked(tmp_path / "scene"), pytest.raises(BuildLockedError, match="is running"):
        build(options_for(hill_file, tmp_path / "scene"))


FULL_DISK = """
import resource, signal, sys
from pathlib import Path
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_pipeline.errors import ResourceError
from terraport_store.errors import OutOfSpaceError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
limit = int(sys.argv[3])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    build(BuildOptions(Path(sys.argv[1]), Path(sys.argv[2])))
except (ResourceError, OutOfSpaceError) as error:
    print(error)
    sys.exit(17)
"""


@pytest.mark.parametrize("limit", [40_000, 100_000], ids=["reading", "reconstructing"])
def test_a_full_disk_is_named_and_leaves_the_old_scene(copy: Path, limit: int) -> None:
    """A limit on file sizes stands for the disk: the same error, at a place we choose."""
    before = published_bytes(copy / "hill")
    shutil.rmtree(copy / ".hill.work")
    ended = subprocess.run(
        [sys.executable, "-c", FULL_DISK, copy / "hill.xyz", copy / "hill", str(limit)],
        check=False,
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 17, ended.stderr
    assert "space" in ended.stdout
    assert published_bytes(copy / "hill") == before
    assert not list((copy / ".hill.work").glob(".*.tmp"))
