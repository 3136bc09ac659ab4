"""Every block of the pages runs as it stands, or the page says why not.

A block without ``<!-- not run: REASON -->`` above it is run in order, in a folder with what the
pages speak of: surveys, photos, a delivery, one scene. Three things stand in, for the time: `serve`
runs in a thread on a free port; of `build` all is done up to the reading (options, files, headers,
photos and cameras) and the one scene taken for the result; no pictures of reports are drawn.
``-m thorough`` builds and exports.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pye57
import pytest
from doc_blocks import ROOT, Shell, blocks_of, in_process, pages, working_in

from terraport_pipeline.cli import build as build_command
from terraport_pipeline.engines.camera_files import read_raw_cameras
from terraport_pipeline.engines.camera_files.write_opensfm import write_opensfm
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.report.report import ReportResult
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.workflow.build import BuildOptions
from terraport_pipeline.workflow.photo_input import locate_photos
from terraport_pipeline.workflow.report import BuildReport
from terraport_store import Scene, change_labels, read_manifest

ELSEWHERE = {"docs/how-to/python-sdk.md": "tests/socket/test_sdk_docs.py"}
"""Pages whose blocks another test runs, for a scene of its own."""

MADE_THERE = {
    "docs/tutorial/first-scene.md": ("quarry.laz", "quarry.truth.npz"),
    "docs/how-to/export.md": ("pit.laz",),
}
"""What a page writes itself, and would refuse to write over."""

SLOW = {"docs/how-to/export.md": "a picture of 16 million pixels: half a minute"}
"""Pages that are run with the thorough tests alone, and why."""

TO_SCENE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])

BLOCKS = {
    page.relative_to(ROOT).as_posix(): blocks_of(page)
    for page in pages()
    if page.relative_to(ROOT).as_posix() not in ELSEWHERE
}

PAGES_THAT_RUN = [
    page for page, blocks in BLOCKS.items() if any(not block.not_run for block in blocks)
]

SETTINGS = ("TERRAPORT_TOKEN", "TERRAPORT_SCENES_DIR", "TERRAPORT_SCENES_URL")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make what the pages speak of, once: from 20,000 points and six small photos."""
    root = tmp_path_factory.mktemp("pages")
    with working_in(root):
        in_process(
            "synth", "-o", "quarry.laz", "--points", "20k", "--photos", "quarry-photos",
            "--photo-size", "320x240", "--photo-count", "6",
        )  # fmt: skip
        for name in ("pit.laz", "survey.laz", "big.laz"):
            shutil.copy("quarry.laz", name)
        in_process(
            "build", "quarry.laz", "-o", "scenes/quarry", "--max-extent-m", "80", "--no-report"
        )
        for name in ("pit", "may", "june", "trial"):
            shutil.copytree("scenes/quarry", f"scenes/{name}")
        shutil.copytree("scenes/.quarry.work", "scenes/.pit.work")
        Path("archive").mkdir()
        with Scene.open("scenes/pit") as scene:
            largest = max(scene.regions["regions"], key=lambda region: float(region["area_m2"]))
        change_labels(Path("scenes/pit"), {int(largest["stable_id"]): "stockpile 3"})
        shutil.copytree("quarry-photos/images", "images")
        shutil.copytree("quarry-photos/colmap", "colmap")
        _write_other_surveys()
        _write_odm_project()
    return root


def _write_other_surveys() -> None:
    cloud = laspy.read("quarry.laz")
    xyz = np.array(cloud.xyz)
    for folder in ("delivery", "north"):
        Path(folder).mkdir()
        for number, half in enumerate((xyz[:, 0] < np.median(xyz[:, 0]), slice(None))):
            tile = laspy.LasData(cloud.header)
            tile.points = cloud.points[half]
            tile.write(f"{folder}/tile_{number}.laz")
    with pye57.E57("extra.e57", mode="w") as file:
        names = ("cartesianX", "cartesianY", "cartesianZ")
        file.write_scan_raw(dict(zip(names, xyz[::10].T.copy(), strict=True)))
    # What the files of "What the files do not say" do not say: CRS, unit, columns.
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.offsets, header.scales = (980_000.0, 190_000.0, 0.0), (0.01, 0.01, 0.01)
    bare = laspy.LasData(header)
    bare.xyz = (xyz - xyz.min(axis=0)) / 0.3048 + (980_000.0, 190_000.0, 20.0)
    bare.write("pit.las")
    numbers = np.arange(len(xyz))
    table = np.column_stack([numbers, xyz[:, 1], xyz[:, 0], xyz[:, 2], *[numbers % 256] * 3])
    np.savetxt("pit.txt", table, fmt=["%d", "%.3f", "%.3f", "%.3f", "%d", "%d", "%d"])


def _write_odm_project() -> None:
    raw = read_raw_cameras(Path("colmap"))
    offset = np.array(raw.frames[0].offset)
    views = [
        View(one.name, one.lens, one.rotation @ TO_SCENE.T, TO_SCENE @ one.centre)
        for one in raw.cameras
    ]
    project = Path("odm-project")
    east, north = offset[:2].tolist()
    write_opensfm(project, views, origin=offset, offset=(east, north))
    shutil.copytree("images", project / "images")
    shutil.copy("quarry.laz", project / "odm_georeferencing" / "odm_georeferenced_model.laz")


@pytest.fixture
def shell(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Shell]:
    """A folder with all of it, of the page's own."""
    shutil.copytree(place, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    for name in SETTINGS:
        monkeypatch.delenv(name, raising=False)
    with Shell(monkeypatch) as shell:
        yield shell


def _read_only(options: BuildOptions, *_: Any, **__: Any) -> BuildReport:
    """Do of a build what refuses wrong words: options, files, headers, cameras, photos."""
    find_survey(
        options.inputs,
        skip_damaged=options.skip_damaged,
        extent=options.extent,
        statement=options.statement,
    ).heads(NullProgress())
    if options.texture is not None:
        locate_photos(options.texture, NullProgress())
    if not options.scene.exists():
        shutil.copytree("scenes/quarry", options.scene)
    return BuildReport(options.scene, "0" * 12, True, (), 0.0)


def _no_pictures(scene: Path, *_: Any, **__: Any) -> ReportResult:
    """Do of a report what refuses wrong words: the scene is there."""
    read_manifest(scene)
    return ReportResult(scene / "report.html", 0, scene / "report.pdf", 0, (), None, None)


@pytest.mark.parametrize("page", [page for page in PAGES_THAT_RUN if page not in SLOW])
def test_blocks_run(page: str, shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build_command, "_build", _read_only)
    monkeypatch.setattr("terraport_pipeline.report.report.write_report", _no_pictures)
    _run(page, shell)


@pytest.mark.thorough  # fifteen builds and five exports: minutes on a busy machine
@pytest.mark.parametrize(
    "page",
    [
        page
        for page in PAGES_THAT_RUN
        if page in SLOW
        or any("terraport build" in block.code and not block.not_run for block in BLOCKS[page])
    ],
)
def test_builds_and_exports_run(page: str, shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    # A report's pictures take longer than the build; tests/pipeline/look draws them.
    monkeypatch.setattr("terraport_pipeline.report.report.write_report", _no_pictures)
    _run(page, shell)


def _run(page: str, shell: Shell) -> None:
    for name in MADE_THERE.get(page, ()):
        Path(name).unlink()
    for block in BLOCKS[page]:
        if not block.not_run:
            shell.run(block)


def test_what_is_not_run_says_why() -> None:
    reasons = {str(block): block.not_run for page in BLOCKS.values() for block in page}
    for where, reason in reasons.items():
        assert not reason or len(reason) > 10, f"{where}: {reason!r} says nothing"
    assert len([reason for reason in reasons.values() if not reason]) > 20


def test_other_pages_are_run_elsewhere() -> None:
    for page, test in ELSEWHERE.items():
        assert page in (ROOT / test).read_text(encoding="utf-8")
