"""``terraport report``: one HTML page about a scene with everything inside it, and one page of PDF.

The HTML page asks for nothing else: pictures are inlined, there is no script, and it follows the
reader's choice of light or dark. Its first screen and the PDF say the same to a surveyor.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.regions.region_changes import ChangeMap
from terraport_pipeline.progress import NullProgress, Progress, ProgressBehind
from terraport_pipeline.published.scene_model import WHOLE_FACES, SceneModel, load_scene_model
from terraport_pipeline.report.accuracy import Accuracy, AccuracyMeter
from terraport_pipeline.report.change_map import find_change_map
from terraport_pipeline.report.facts import collect_facts, read_build_record
from terraport_pipeline.report.handoff_pictures import hand_off_pictures, worst_place_picture
from terraport_pipeline.report.html_page import page_templates, replace_bytes, replace_page
from terraport_pipeline.report.input_cloud import InputCloud
from terraport_pipeline.report.pdf_page import pdf_page
from terraport_pipeline.report.picture import Picture, PictureOptions, preview_of
from terraport_pipeline.report.pictures import PictureTaker
from terraport_pipeline.report.surveyor import (
    Overlap,
    SurveyorFacts,
    photo_overlap,
    surveyor_facts,
)
from terraport_pipeline.report.textures import (
    VertexColours,
    find_vertex_colours,
    photo_pictures,
    photo_rows,
    texture_rows,
)
from terraport_pipeline.validate.handoff import check_hand_off
from terraport_pipeline.validate.handoff_report import HandOffOptions, HandOffReport
from terraport_pipeline.validate.scene_windows import prove_in_windows, segments_around
from terraport_store import Scene, read_manifest
from terraport_store.layout import PREVIEW, REPORT, REPORT_PDF

__all__ = ["ReportOptions", "ReportResult", "write_report"]

THINNED_FACES: Final = 6_000_000
"""Faces that a scene larger than memory is drawn with: finer than a pixel of the overview."""


@dataclass(frozen=True, slots=True)
class ReportOptions:
    """Size of the pictures and effort of the proof."""

    pictures: PictureOptions = field(default_factory=PictureOptions)
    rays: int = 200_000
    """Rays of the hand-off's proof; 0 leaves it out. ``terraport validate`` casts more."""
    subsets: int = 40
    seed: int = 0


@dataclass(frozen=True, slots=True)
class ReportResult:
    """The pages that were written, their pictures, and the proof's report."""

    path: Path
    bytes: int
    pdf_path: Path
    pdf_bytes: int
    pictures: tuple[str, ...]
    """Keys of the pictures, in order."""
    proof: HandOffReport | None
    accuracy: Accuracy | None
    """None where the survey's points are not at hand."""


def write_report(
    scene_path: Path,
    output: Path | None = None,
    options: ReportOptions | None = None,
    *,
    cloud: Callable[[Scene], InputCloud | None] | None = None,
    photos: Callable[[SceneModel], OpenPhotos] | None = None,
    work: Path | None = None,
    progress: Progress | None = None,
) -> ReportResult:
    """Write the report of a scene, as a page of HTML and as one of PDF, and its small picture.

    Parameters
    ----------
    scene_path : Path
        The scene directory.
    output : Path, optional
        The page; ``report.html`` in the scene directory by default. Replaced in one step, and so is
        the PDF of the same name beside it.
    options : ReportOptions, optional
        Size of the pictures, rays of the proof.
    cloud : callable, optional
        Finds the points of the input, in the scene's frame; None, or its answer None, means that
        there is no picture of the input and that accuracy is not known, and the page says so.
    photos : callable, optional
        Opens the photos of a textured scene, to show them beside it; not of one too large for
        memory.
    work : Path, optional
        The build's work directory, for the vertex colours of a textured scene; ``.SCENE.work``
        beside it by default.
    progress : Progress, optional
        Advances by pictures.

    Returns
    -------
    ReportResult

    Raises
    ------
    SceneNotFoundError, DamagedSceneError
        When the scene cannot be read.
    OptionError
        When the output cannot be written where it is asked for.
    """
    # (1) Refuse what is no scene, and a page that cannot be written, before anything is drawn.
    read_manifest(scene_path)
    chosen, watcher = options or ReportOptions(), progress or NullProgress()
    target = output or scene_path / REPORT
    if not target.absolute().parent.is_dir():
        raise OptionError(
            f"received the output {target}, expected an existing folder {target.parent}"
        )
    pdf_target = target.with_suffix(Path(REPORT_PDF).suffix)
    if pdf_target == target:
        raise OptionError(f"received the output {target}, expected a name that ends in .html")
    # (2) Facts and pictures; a scene too large for memory is drawn thinned.
    with Scene.open(scene_path) as scene:
        points = cloud(scene) if cloud is not None else None
        change = find_change_map(scene, work)
        facts = collect_facts(
            scene, has_input=points is not None, has_change_map=change is not None
        )
        record = read_build_record(scene.path)
        textures = texture_rows(scene.manifest, record)
        asked = _Asked(scene, record, points, change, chosen, watcher)
        if int(scene.index.face_count.sum(dtype=np.int64)) > WHOLE_FACES:
            looked = _look_at_large(asked)
        else:
            beside = None
            if photos is not None and textures:
                beside = _Beside(photos, find_vertex_colours(scene, work))
            looked = _look_at(asked, beside)
    # (3) Two pages with everything inside, and the scene's small picture, each put in its place in
    # one step.
    pictures = {picture.key: picture for picture in (*looked.first, *looked.overview)}
    page = (
        page_templates("terraport_pipeline.report")
        .get_template("report.html.j2")
        .render(
            facts=facts,
            survey=looked.survey,
            pictures=pictures,
            overview=[picture for picture in looked.overview if picture.key in _SHOWN],
            internals=[picture for picture in looked.overview if picture.key in _INTERNALS],
            attributes=[
                picture for picture in looked.overview if picture.key.startswith("attribute-")
            ],
            changes=[picture for picture in looked.overview if picture.key.startswith("change")],
            textures=textures,
            served=photo_rows(record),
            compared=looked.compared,
            landing=looked.landing,
            proof=looked.proof,
        )
    )
    size = replace_page(target, page)
    pdf_size = replace_bytes(pdf_target, pdf_page(looked.survey, pictures))
    replace_bytes(scene_path / PREVIEW, preview_of(pictures["detail"]))
    shown = (*looked.first, *looked.overview, *looked.compared, *looked.landing)
    return ReportResult(
        target, size, pdf_target, pdf_size, tuple(picture.key for picture in shown),
        looked.proof, looked.accuracy,
    )  # fmt: skip


_SHOWN: Final = ("input", "detail", "regions")
_INTERNALS: Final = ("base", "segments")
"""Pictures of the whole scene that everybody sees, and those of what is streamed."""


@dataclass(frozen=True, slots=True)
class _Asked:
    """What a report is drawn of."""

    scene: Scene
    record: dict[str, Any]
    points: InputCloud | None
    change: ChangeMap | None
    chosen: ReportOptions
    watcher: Progress


@dataclass(frozen=True, slots=True)
class _Beside:
    """Photos and vertex colours that a textured scene is compared with."""

    photos: Callable[[SceneModel], OpenPhotos]
    plain: VertexColours | None


@dataclass(slots=True)
class _Looked:
    """What was drawn, measured and proven."""

    survey: SurveyorFacts
    accuracy: Accuracy | None
    first: list[Picture]
    overview: list[Picture]
    landing: list[Picture] = field(default_factory=list)
    compared: list[Picture] = field(default_factory=list)
    proof: HandOffReport | None = None


def _look_at(asked: _Asked, beside: _Beside | None) -> _Looked:
    """Draw, measure and prove a scene that fits into memory."""
    chosen, watcher = asked.chosen, asked.watcher
    model = load_scene_model(asked.scene, progress=watcher)
    taker = PictureTaker(model, chosen.pictures)
    # (1) The proof of the hand-off, on a thread of its own: neither it nor the pictures have work
    # for all cores at all times.
    with ThreadPoolExecutor(1) as pool:
        behind = ProgressBehind("hand-off: rays")
        proving = pool.submit(_prove, model, taker, chosen, behind) if chosen.rays else None
        # (2) The first screen. Photos are opened once, for their overlap and for their pictures.
        opened = None if beside is None else beside.photos(model)
        overlap = None if opened is None else photo_overlap(opened.views, model.detail)
        looked = _first_look(asked, taker, model, _meter(asked), overlap)
        # (3) The scene as a whole, its landing, and photos beside it.
        watcher.start("pictures", None, "pictures")
        looked.overview = _overview(taker, asked)
        for picture in hand_off_pictures(model, taker.landing, taker.detail_rays, chosen.pictures):
            looked.landing.append(picture)
            watcher.advance(1)
        watcher.done({"pictures": len(looked.overview) + len(looked.landing)})
        if beside is not None and opened is not None:
            watcher.start("pictures: photos", None, "pictures")
            for picture in photo_pictures(
                model, taker.detail_rays, opened, beside.plain, chosen.pictures
            ):
                looked.compared.append(picture)
                watcher.advance(1)
            watcher.done({"pictures": len(looked.compared)})
        # (4) What the proof found.
        if proving is not None:
            behind.show(watcher, proving)
            looked.proof, worst = proving.result()
            looked.landing += worst
    return looked


def _prove(
    model: SceneModel, taker: PictureTaker, chosen: ReportOptions, watcher: Progress
) -> tuple[HandOffReport, list[Picture]]:
    """Prove the hand-off of a scene in memory; with the picture of its worst place, if any."""
    rays = {"detail_rays": taker.detail_rays, "base_rays": taker.base_rays}
    proof = check_hand_off(model.hand_off_model(), _proof_options(chosen), progress=watcher, **rays)
    if proof.worst is None:
        return proof, []
    return proof, [worst_place_picture(model, proof.worst, chosen.pictures, **rays)]


def _look_at_large(asked: _Asked) -> _Looked:
    """Draw a scene larger than memory thinned, its landing in full, and prove it in windows.

    Points are measured against every segment in full detail, as it is read to be thinned.
    """
    # (1) The first screen and the scene as a whole, from one thinned model.
    scene, chosen, watcher = asked.scene, asked.chosen, asked.watcher
    meter = _meter(asked)
    model = load_scene_model(
        scene,
        max_faces=THINNED_FACES,
        each=None if meter is None else meter.add,
        progress=watcher,
    )
    taker = PictureTaker(model, chosen.pictures)
    looked = _first_look(asked, taker, model, meter, None)
    watcher.start("pictures", None, "pictures")
    looked.overview = _overview(taker, asked)
    watcher.done({"pictures": len(looked.overview)})
    # (2) One landing in full detail.
    near = np.zeros(len(scene.index), np.bool_)
    near[segments_around(scene, taker.landing.position, THINNED_FACES)] = True
    stand = taker.landing
    del taker, model
    model = load_scene_model(
        scene, max_faces=2 * THINNED_FACES, whole=near & stand.loaded, progress=watcher
    )
    rays = RayScene(model.detail.vertices, model.detail.faces)
    looked.landing = list(hand_off_pictures(model, stand, rays, chosen.pictures))
    del model, rays
    # (3) The proof of the hand-off.
    if not chosen.rays:
        return looked
    looked.proof = prove_in_windows(scene, _proof_options(chosen), watcher)
    worst = looked.proof.worst
    if worst is not None:
        around = segments_around(scene, worst.target, THINNED_FACES)
        near_model = load_scene_model(scene, segments=around, progress=watcher)
        looked.landing.append(worst_place_picture(near_model, worst, chosen.pictures))
    return looked


def _meter(asked: _Asked) -> AccuracyMeter | None:
    """Choose the points that the mesh is measured by; None where none are at hand."""
    points = asked.points
    if points is None:
        return None
    if points.surveyed is not None:
        return AccuracyMeter(points.surveyed, points.spacing_m, points.read)
    return AccuracyMeter(points.points, points.spacing_m, points.total)


def _first_look(
    asked: _Asked,
    taker: PictureTaker,
    model: SceneModel,
    meter: AccuracyMeter | None,
    overlap: Overlap | None,
) -> _Looked:
    """Draw the plan, measure the mesh, and gather what a surveyor asks first."""
    watcher = asked.watcher
    watcher.start("plan and accuracy", None, "pictures")
    plan = taker.plan()
    accuracy = None if meter is None else meter.finish(model.detail)
    pictures = taker.plan_pictures(plan, accuracy)
    legend = pictures[-1].legend
    survey = surveyor_facts(
        asked.scene,
        asked.record,
        plan,
        model.detail,
        accuracy,
        spacing_m=0.0 if asked.points is None else asked.points.spacing_m,
        overlap=overlap,
        map_top_m=None if legend is None else legend.high,
    )
    watcher.done({"pictures": len(pictures)})
    return _Looked(survey, accuracy, pictures, [])


def _proof_options(chosen: ReportOptions) -> HandOffOptions:
    return HandOffOptions(chosen.rays, min(chosen.subsets, chosen.rays), chosen.seed)


def _overview(taker: PictureTaker, asked: _Asked) -> list[Picture]:
    """Take the pictures of the whole scene; last those of what changed."""
    overview = []
    for picture in taker.overview(asked.points):
        overview.append(picture)
        asked.watcher.advance(1)
    if asked.change is not None:
        for picture in taker.change(asked.change):
            overview.append(picture)
            asked.watcher.advance(1)
    return overview
