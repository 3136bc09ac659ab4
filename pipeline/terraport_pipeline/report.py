"""``terraport report``: one HTML page about a scene, with everything inside it.

The page asks for nothing else: pictures are inlined, there is no script, and it follows the
reader's choice of light or dark.
"""

from __future__ import annotations

import base64
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from jinja2 import Environment, PackageLoader, StrictUndefined

from terraport_pipeline.errors import OptionError
from terraport_pipeline.handoff import check_hand_off
from terraport_pipeline.handoff_report import HandOffOptions, HandOffReport
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.report_facts import collect_facts, format_bytes
from terraport_pipeline.report_pictures import (
    InputCloud,
    Picture,
    PictureOptions,
    PictureTaker,
)
from terraport_pipeline.scene_model import load_scene_model
from terraport_store import Scene

__all__ = ["REPORT_NAME", "ReportOptions", "ReportResult", "write_report"]

REPORT_NAME: Final = "report.html"
"""Where a server looks for it, in the scene directory."""


@dataclass(frozen=True, slots=True)
class ReportOptions:
    """What goes into a report."""

    pictures: PictureOptions = field(default_factory=PictureOptions)
    rays: int = 200_000
    """Rays of the hand-off's proof; 0 leaves it out. ``terraport validate`` casts more."""
    subsets: int = 40
    seed: int = 0


@dataclass(frozen=True, slots=True)
class ReportResult:
    """What was written."""

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
    chosen, watcher = options or ReportOptions(), progress or NullProgress()
    target = output or scene_path / REPORT_NAME
    if not target.absolute().parent.is_dir():
        raise OptionError(
            f"received the output {target}, expected an existing folder {target.parent}"
        )
    with Scene.open(scene_path) as scene:
        model = load_scene_model(scene, progress=watcher)
        points = cloud(scene) if cloud is not None else None
        facts = collect_facts(scene, has_input=points is not None)
    taker = PictureTaker(model, chosen.pictures)
    watcher.start("pictures", None, "pictures")
    overview, landing = _taken(taker, points, watcher)
    watcher.done({"pictures": len(overview) + len(landing)})
    proof = None
    if chosen.rays:
        proof = check_hand_off(
            model.hand_off_model(),
            HandOffOptions(chosen.rays, min(chosen.subsets, chosen.rays), chosen.seed),
            progress=watcher,
            detail_rays=taker.detail_rays,
            base_rays=taker.base_rays,
        )
        if proof.worst is not None:
            landing.append(taker.worst_place(proof.worst))
    page = (
        _environment()
        .get_template("report.html.j2")
        .render(facts=facts, overview=overview, landing=landing, proof=proof)
    )
    data = page.encode("utf-8")
    _replace(target, data)
    keys = tuple(picture.key for picture in (*overview, *landing))
    return ReportResult(target, len(data), keys, proof)


def _taken(
    taker: PictureTaker, points: InputCloud | None, watcher: Progress
) -> tuple[list[Picture], list[Picture]]:
    overview, landing = [], []
    for picture in taker.overview(points):
        overview.append(picture)
        watcher.advance(1)
    for picture in taker.hand_off():
        landing.append(picture)
        watcher.advance(1)
    return overview, landing


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("terraport_pipeline"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["base64"] = lambda data: base64.b64encode(data).decode("ascii")
    environment.filters["bytes"] = format_bytes
    environment.filters["amount"] = lambda value: f"{value:,.0f}"
    return environment


def _replace(target: Path, data: bytes) -> None:
    """Write beside the target and rename: a reader sees the old page or the new one."""
    draft = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        draft.write_bytes(data)
        draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)
