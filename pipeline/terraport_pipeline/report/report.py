"""``terraport report``: one HTML page about a scene, with everything inside it.

The page asks for nothing else: pictures are inlined, there is no script, and it follows the
reader's choice of light or dark.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.regions.region_changes import ChangeMap
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.published.scene_model import WHOLE_FACES, SceneModel, load_scene_model
from terraport_pipeline.report.change_map import find_change_map
from terraport_pipeline.report.facts import collect_facts, read_build_record
from terraport_pipeline.report.html_page import page_templates, replace_page
from terraport_pipeline.report.pictures import (
    InputCloud,
    Picture,
    PictureOptions,
    PictureTaker,
)
from terraport_pipeline.report.textures import (
    VertexColours,
    find_vertex_colours,
    photo_pictures,
    texture_rows,
)
from terraport_pipeline.validate.handoff import check_hand_off
from terraport_pipeline.validate.handoff_report import HandOffOptions, HandOffReport
from terraport_pipeline.validate.scene_windows import prove_in_windows, segments_around
from terraport_store import Scene, read_manifest

__all__ = ["REPORT_NAME", "ReportOptions", "ReportResult", "write_report"]

REPORT_NAME: Final = "report.html"
"""Where a server looks for it, in the scene directory."""


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
    """The page that was written, its pictures, and the proof's report."""

    path: Path
    bytes: int
    pictures: tuple[str, ...]
    """Keys of the pictures, in order."""
    proof: HandOffReport | None


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
    """Write the report of a scene.

    Parameters
    ----------
    scene_path : Path
        The scene directory.
    output : Path, optional
        The page; ``report.html`` in the scene directory by default. Replaced in one step.
    options : ReportOptions, optional
        Size of the pictures, rays of the proof.
    cloud : callable, optional
        Finds the points of the input, in the scene's frame; None, or its answer None, means that
        there is no picture of the input, and the page says so.
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
    target = output or scene_path / REPORT_NAME
    if not target.absolute().parent.is_dir():
        raise OptionError(
            f"received the output {target}, expected an existing folder {target.parent}"
        )
    # (2) Facts and pictures; a scene too large for memory is drawn thinned.
    with Scene.open(scene_path) as scene:
        points = cloud(scene) if cloud is not None else None
        change = find_change_map(scene, work)
        facts = collect_facts(
            scene, has_input=points is not None, has_change_map=change is not None
        )
        textures = texture_rows(scene.manifest, read_build_record(scene.path))
        compared: list[Picture] = []
        if int(scene.index.face_count.sum(dtype=np.int64)) > WHOLE_FACES:
            overview, landing, proof = _look_at_large(scene, points, change, chosen, watcher)
        else:
            beside = None
            if photos is not None and textures:
                beside = _Beside(photos, find_vertex_colours(scene, work), compared)
            overview, landing, proof = _look_at(scene, points, change, chosen, watcher, beside)
    # (3) One page with everything inside, put in its place in one step.
    page = (
        page_templates("terraport_pipeline.report")
        .get_template("report.html.j2")
        .render(
            facts=facts,
            overview=[picture for picture in overview if not picture.key.startswith("change")],
            changes=[picture for picture in overview if picture.key.startswith("change")],
            textures=textures,
            compared=compared,
            landing=landing,
            proof=proof,
        )
    )
    size = replace_page(target, page)
    keys = tuple(picture.key for picture in (*overview, *compared, *landing))
    return ReportResult(target, size, keys, proof)


@dataclass(frozen=True, slots=True)
class _Beside:
    """Photos and vertex colours that a textured scene is compared with."""

    photos: Callable[[SceneModel], OpenPhotos]
    plain: VertexColours | None
    pictures: list[Picture]
    """Gets the pictures that were drawn."""


def _look_at(
    scene: Scene,
    points: InputCloud | None,
    change: ChangeMap | None,
    chosen: ReportOptions,
    watcher: Progress,
    beside: _Beside | None,
) -> tuple[list[Picture], list[Picture], HandOffReport | None]:
    """Draw and prove a scene that fits into memory."""
    model = load_scene_model(scene, progress=watcher)
    taker = PictureTaker(model, chosen.pictures)
    watcher.start("pictures", None, "pictures")
    overview, landing = _taken(taker, points, change, watcher)
    watcher.done({"pictures": len(overview) + len(landing)})
    if beside is not None:
        watcher.start("pictures: photos", None, "pictures")
        opened = beside.photos(model)
        for picture in photo_pictures(
            model, taker.detail_rays, opened, beside.plain, chosen.pictures
        ):
            beside.pictures.append(picture)
            watcher.advance(1)
        watcher.done({"pictures": len(beside.pictures)})
    if not chosen.rays:
        return overview, landing, None
    proof = check_hand_off(
        model.hand_off_model(),
        _proof_options(chosen),
        progress=watcher,
        detail_rays=taker.detail_rays,
        base_rays=taker.base_rays,
    )
    if proof.worst is not None:
        landing.append(taker.worst_place(proof.worst))
    return overview, landing, proof


def _look_at_large(
    scene: Scene,
    points: InputCloud | None,
    change: ChangeMap | None,
    chosen: ReportOptions,
    watcher: Progress,
) -> tuple[list[Picture], list[Picture], HandOffReport | None]:
    """Draw a scene larger than memory thinned, its landing in full, and prove it in windows."""
    taker = PictureTaker(
        load_scene_model(scene, max_faces=THINNED_FACES, progress=watcher), chosen.pictures
    )
    watcher.start("pictures", None, "pictures")
    overview = _overview(taker, points, change, watcher)
    watcher.done({"pictures": len(overview)})
    near = np.zeros(len(scene.index), np.bool_)
    near[segments_around(scene, taker.landing.position, THINNED_FACES)] = True
    stand = taker.landing
    del taker
    taker = PictureTaker(
        load_scene_model(
            scene, max_faces=2 * THINNED_FACES, whole=near & stand.loaded, progress=watcher
        ),
        chosen.pictures,
    )
    taker.landing = stand
    landing = list(taker.hand_off())
    del taker
    if not chosen.rays:
        return overview, landing, None
    proof = prove_in_windows(scene, _proof_options(chosen), watcher)
    if proof.worst is not None:
        around = segments_around(scene, proof.worst.target, THINNED_FACES)
        model = load_scene_model(scene, segments=around, progress=watcher)
        landing.append(PictureTaker(model, chosen.pictures).worst_place(proof.worst))
    return overview, landing, proof


def _proof_options(chosen: ReportOptions) -> HandOffOptions:
    return HandOffOptions(chosen.rays, min(chosen.subsets, chosen.rays), chosen.seed)


def _taken(
    taker: PictureTaker, points: InputCloud | None, change: ChangeMap | None, watcher: Progress
) -> tuple[list[Picture], list[Picture]]:
    overview, landing = _overview(taker, points, change, watcher), []
    for picture in taker.hand_off():
        landing.append(picture)
        watcher.advance(1)
    return overview, landing


def _overview(
    taker: PictureTaker, points: InputCloud | None, change: ChangeMap | None, watcher: Progress
) -> list[Picture]:
    """Take the pictures of the whole scene; last those of what changed."""
    overview = []
    for picture in taker.overview(points):
        overview.append(picture)
        watcher.advance(1)
    if change is not None:
        for picture in taker.change(change):
            overview.append(picture)
            watcher.advance(1)
    return overview
