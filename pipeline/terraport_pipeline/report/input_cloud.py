"""The points of the input for the report's picture, from the build's work directory.

A scene does not hold the survey's points. The build's clean stage leaves them, of a large survey a
thinned copy, already in the scene frame, as plain NumPy files; where they are still there and
belong to the published scene they are taken from there. Nothing is written, and nothing is
unpickled. Where that directory is gone, the survey's own files are read again if they are named.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float32, UInt8
from terraport_pipeline.errors import OptionError
from terraport_pipeline.extent import Extent
from terraport_pipeline.model import to_scene
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.published.scene_model import GREY
from terraport_pipeline.published.work_directory import default_work_directory
from terraport_pipeline.report.facts import read_build_record
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey_statement import SurveyStatement
from terraport_store import Scene

__all__ = ["InputCloud", "find_input_cloud", "read_input_cloud"]

MAX_POINTS: Final = 2_000_000
"""Points taken; of a larger cloud every n-th."""

MAX_SAMPLES: Final = 400_000
"""Points as they were read that are taken, about, to measure the mesh by."""

MAX_RECORD_BYTES: Final = 4 << 20
"""Largest stage.json that is read."""

MAX_TILES: Final = 100_000
"""Tiles whose records are read."""


@dataclass(frozen=True, slots=True)
class InputCloud:
    """Points of the survey, as far as the build kept them."""

    points: Float32
    """(N, 3) metres, scene frame."""
    colours: UInt8
    """(N, 3) sRGB."""
    spacing_m: float
    total: int
    """Points of the survey, of which these may be a part."""
    surveyed: Float32 | None = None
    """(M, 3) a sample of the points as they were read, outliers with them, scene frame; None where
    only those that the build cleaned are at hand."""
    read: int = 0
    """Points as they were read, of which those are a sample."""


def find_input_cloud(scene: Scene, work: Path | None = None) -> InputCloud | None:
    """Look for the points that a scene was built from.

    Parameters
    ----------
    scene : Scene
        Open.
    work : Path, optional
        The build's work directory; ``.<scene>.work`` beside the scene by default.

    Returns
    -------
    InputCloud or None
        None when they are not there, are damaged, or belong to another build (another origin or
        number of points): a report goes without.
    """
    folder = (work or default_work_directory(scene.path)) / "clean"
    try:
        with (folder / "stage.json").open("rb") as file:
            record = json.loads(file.read(MAX_RECORD_BYTES))
        spacing_m = float(record["values"]["spacing_m"])
        arrays = {
            name: np.load(folder / f"{name}.npy", mmap_mode="r", allow_pickle=False)
            for name in ("points", "colours", "origin")
        }
    except (OSError, ValueError, KeyError, TypeError, EOFError):
        return None
    points, colours = arrays["points"], arrays["colours"]
    kept = total = len(points)
    if kept != scene.manifest.counts.points:
        total = _points_of_tiles(folder.parent)
    fits = (
        points.shape == colours.shape == (kept, 3)
        and total == scene.manifest.counts.points
        and np.array_equal(arrays["origin"], scene.manifest.origin)
        and np.isfinite(spacing_m)
        and spacing_m > 0
    )
    if not fits:
        return None
    step = max(1, -(-kept // MAX_POINTS))
    # Copied: the picture outlives the mapping. Fewer points stand further apart.
    return InputCloud(
        np.array(points[::step], dtype=np.float32),
        np.array(colours[::step], dtype=np.uint8),
        spacing_m * step**0.5,
        total,
        *_as_read(scene, folder.parent / "read"),
    )


def read_input_cloud(scene: Scene, survey: Path, progress: Progress | None = None) -> InputCloud:
    """Read the survey again that a scene was built from, or a sample of a large one.

    Parameters
    ----------
    scene : Scene
        Open; its build says which CRS, units, columns and extent were stated.
    survey : Path
        A file of it, or its folder.
    progress : Progress, optional
        Told of the reading.

    Raises
    ------
    ReadError, SurveyError
        The survey cannot be read.
    OptionError
        It lies elsewhere than the scene.
    """
    # (1) Its files, meant as the build meant them.
    manifest = scene.manifest
    files, heads = find_survey(survey, extent=_extent(scene), statement=_statement(scene)).heads(
        progress or NullProgress()
    )
    stated = sum(head.points if head.rows is None else head.rows for head in heads)
    share = min(1.0, MAX_POINTS / max(stated, 1))
    read = read_survey(files, max_points=MAX_POINTS, progress=progress, share=share)
    is_thinned = share < 1.0 or len(read.points) >= MAX_POINTS
    total = stated if is_thinned else len(read.points)
    # (2) In the scene's frame, and there.
    points = to_scene(read.points, np.array(manifest.origin))
    low, high = np.array(manifest.bounds.min), np.array(manifest.bounds.max)
    margin_m = float(np.linalg.norm(high - low))
    if not ((points >= low - margin_m) & (points <= high + margin_m)).all(axis=1).any():
        raise OptionError(
            f"the survey {survey} lies elsewhere than the scene {manifest.name}; expected the one "
            "that it was built from"
        )
    colours = read.colours
    if colours is None:
        colours = np.full(points.shape, GREY, np.uint8)
    area_m2 = max(float((high - low)[[0, 2]].prod()), 1e-6)
    return InputCloud(
        points, colours, float(np.sqrt(area_m2 / max(len(points), 1))), total, points, total
    )


def _statement(scene: Scene) -> SurveyStatement:
    """Take what was stated of the survey out of the build's options."""
    recorded = scene.manifest.build.options.get("statement")
    stated: dict[str, Any] = dict(recorded) if isinstance(recorded, dict) else {}
    if isinstance(stated.get("columns"), list):
        stated["columns"] = tuple(stated["columns"])
    return SurveyStatement(**stated)


def _extent(scene: Scene) -> Extent | None:
    """Take the extent that a scene was built from out of the build's record."""
    extent = read_build_record(scene.path).get("extent")
    values = extent.get("values") if isinstance(extent, dict) else None
    try:
        return None if values is None else Extent(*(float(value) for value in values))
    except (TypeError, ValueError):
        return None


def _as_read(scene: Scene, folder: Path) -> tuple[Float32 | None, int]:
    """Take a sample of the points as they were read for this scene, and their number."""
    source = scene.manifest.build.input
    try:
        with (folder / "stage.json").open("rb") as file:
            digest = str(json.loads(file.read(MAX_RECORD_BYTES))["digest"])
        points = np.load(folder / "points.npy", mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, KeyError, TypeError, EOFError):
        return None, 0
    if source is None or not digest.startswith(source.xxh3):
        return None, 0
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        return None, 0
    step = max(1, len(points) // MAX_SAMPLES)
    origin = np.array(scene.manifest.origin)
    return to_scene(np.array(points[::step], dtype=np.float64), origin), len(points)


def _points_of_tiles(work: Path) -> int:
    """Add up the points of all tiles, where the clean stage holds a thinned copy; 0 for none."""
    total = 0
    try:
        for record in islice(work.glob("solve-*/stage.json"), MAX_TILES):
            with record.open("rb") as file:
                total += int(json.loads(file.read(MAX_RECORD_BYTES))["values"]["core"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0
    return total
