"""``terraport evaluate reconstruction``: six algorithms on clouds with truth; Poisson by depth."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import os
import platform
import tempfile
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.errors import PipelineError
from terraport_pipeline.progress import NullProgress, Progress
from terraport_research.depth_sweep import DepthScene, sweep
from terraport_research.options import ReconstructionOptions
from terraport_research.pictures import picture_of_mesh, picture_of_samples
from terraport_research.runs import Run, run
from terraport_research.scores import Scores, score
from terraport_research.subjects import STANFORD, Subject, body, quarry, stanford
from terraport_research.verdicts import (
    RULES,
    ColourVerdict,
    ShapeVerdict,
    judge_colour,
    judge_shape,
)

__all__ = ["Evaluation", "Result", "evaluate", "to_json"]

_PACKAGES: Final = ("terraport", "numpy", "scipy", "numba", "pycolmap", "embreex")


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Run and scores of one algorithm on one cloud."""

    algorithm: str
    run: Run
    scores: Scores | None
    picture: bytes | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """One cloud and the results of all algorithms on it."""

    key: str
    title: str
    points: int
    spacing_m: float
    origin: str
    neighbour_colour_p95: float
    results: tuple[Result, ...]
    picture: bytes | None = None
    truth_picture: bytes | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Results of a comparison: all algorithms on all clouds, verdicts, and what was left out."""

    options: ReconstructionOptions
    ground: Compared | None
    """The quarry: Table 3.1."""
    models: tuple[Compared, ...]
    """Subjects of Table 3.2, with the results of every algorithm."""
    colour: dict[str, ColourVerdict]
    shape: dict[str, ShapeVerdict]
    scenes: tuple[DepthScene, ...]
    skipped: tuple[str, ...]
    """Clouds that are not there, and why."""
    versions: dict[str, str] = field(default_factory=dict)


def evaluate(options: ReconstructionOptions, progress: Progress | None = None) -> Evaluation:
    """Compare reconstruction algorithms.

    Parameters
    ----------
    options : ReconstructionOptions
    progress : Progress, optional
        Advances by reconstructions.

    Returns
    -------
    Evaluation
        The result lists missing data files.

    Raises
    ------
    OptionError
        An option is invalid; raised before any work.
    """
    watcher = progress or NullProgress()
    skipped: list[str] = []
    compared: list[Compared] = []
    with tempfile.TemporaryDirectory(prefix="terraport-evaluate-") as folder:
        scratch = Path(folder)
        for make in _subjects(options, scratch) if options.algorithms else []:
            try:
                subject = make()
            except PipelineError as error:
                skipped.append(str(error))
                continue
            compared.append(_compare(subject, options, scratch, watcher))
        scenes = _sweeps(options, scratch, watcher, skipped)
    ground = next((one for one in compared if one.key == "quarry"), None)
    models = tuple(one for one in compared if one is not ground)
    return Evaluation(
        options,
        ground,
        models,
        _colour_table(ground),
        _shape_table(options, models),
        scenes,
        tuple(skipped),
        _versions(),
    )


def _subjects(options: ReconstructionOptions, scratch: Path) -> list[Callable[[], Subject]]:
    makers: list[Callable[[], Subject]] = [partial(quarry, options.points, scratch)]
    for name in options.models:
        if name in STANFORD:
            makers.append(partial(stanford, name, options.data, options.points))
        else:
            makers.append(partial(body, name, options.points))
    return makers


def _compare(
    subject: Subject, options: ReconstructionOptions, scratch: Path, watcher: Progress
) -> Compared:
    """Run every algorithm on one cloud, several at once, and measure what they made."""
    watcher.start(f"{subject.title}: algorithms", float(len(options.algorithms)), "algorithms")

    def one(key: str) -> Run:
        return run(key, subject.samples, scratch, time_limit_s=options.time_limit_s)

    results = []
    with ThreadPoolExecutor(options.workers) as pool:
        started: list[tuple[str, Future[Run]]] = [
            (key, pool.submit(one, key)) for key in options.algorithms
        ]
        for key, future in started:
            results.append(_measured(key, future.result(), subject, options))
            watcher.advance(1)
    watcher.done({"points": len(subject.samples.points)})
    cloud = picture_of_samples(subject) if options.pictures else None
    truth = (
        picture_of_mesh(subject, subject.truth_vertices, subject.truth_faces, None)
        if options.pictures and subject.closed
        else None
    )
    return Compared(
        subject.key,
        subject.title,
        len(subject.samples.points),
        subject.samples.spacing_m,
        subject.origin,
        subject.neighbour_colour_p95,
        tuple(results),
        cloud,
        truth,
    )


def _measured(key: str, outcome: Run, subject: Subject, options: ReconstructionOptions) -> Result:
    if outcome.surface is None or outcome.colours is None:
        return Result(key, outcome, None)
    picture = None
    if options.pictures:
        picture = picture_of_mesh(
            subject, outcome.surface.vertices, outcome.surface.faces, outcome.colours
        )
    return Result(key, outcome, score(outcome.surface, outcome.colours, subject), picture)


def _sweeps(
    options: ReconstructionOptions, scratch: Path, watcher: Progress, skipped: list[str]
) -> tuple[DepthScene, ...]:
    scenes = []
    for name in options.scenes if options.depths else ():
        watcher.start(f"{Path(name).name}: octree depths", float(len(options.depths)), "depths")
        try:
            scene = sweep(
                name,
                options.data,
                options.depths,
                options.depth_points,
                scratch,
                threads=options.workers,
                progress=watcher,
            )
        except PipelineError as error:
            skipped.append(str(error))
        else:
            scenes.append(scene)
        watcher.done({})
    return tuple(scenes)


def _colour_table(ground: Compared | None) -> dict[str, ColourVerdict]:
    if ground is None:
        return {}
    return {
        one.algorithm: judge_colour(one.algorithm, one.scores, ground.neighbour_colour_p95)
        for one in ground.results
        if one.scores is not None
    }


def _shape_table(
    options: ReconstructionOptions, models: tuple[Compared, ...]
) -> dict[str, ShapeVerdict]:
    """Judge algorithms that came through on every model."""
    table = {}
    for key in options.algorithms:
        scores = [one.scores for model in models for one in model.results if one.algorithm == key]
        valid = [one for one in scores if one is not None]
        if valid and len(valid) == len(scores):
            table[key] = judge_shape(key, valid)
    return table


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version(), "cores": str(os.cpu_count())}
    for name in _PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def to_json(evaluation: Evaluation) -> str:
    """Write everything measured as JSON (no pictures), lengths in metres, shares of one."""

    def compared(one: Compared) -> dict[str, Any]:
        return {
            "key": one.key,
            "title": one.title,
            "origin": one.origin,
            "points": one.points,
            "spacing_m": one.spacing_m,
            "neighbour_colour_p95": one.neighbour_colour_p95,
            "results": [
                {
                    "algorithm": result.algorithm,
                    "made_by": result.run.algorithm.implementation,
                    "note": result.run.surface.note if result.run.surface else "",
                    "error": result.run.error,
                    "cpu_s": round(result.run.cpu_s, 3),
                    "wall_s": round(result.run.wall_s, 3),
                    "added_bytes": result.run.added_bytes,
                    "scores": None if result.scores is None else dataclasses.asdict(result.scores),
                }
                for result in one.results
            ],
        }

    content = {
        "rules": RULES,
        "points": evaluation.options.points,
        "depth_points": evaluation.options.depth_points,
        "ground": None if evaluation.ground is None else compared(evaluation.ground),
        "models": [compared(one) for one in evaluation.models],
        "table_3_1": {key: dataclasses.asdict(one) for key, one in evaluation.colour.items()},
        "table_3_2": {
            key: {**dataclasses.asdict(one), "proceed": one.proceed}
            for key, one in evaluation.shape.items()
        },
        "figure_5_8": [dataclasses.asdict(scene) for scene in evaluation.scenes],
        "skipped": evaluation.skipped,
        "versions": evaluation.versions,
    }
    return json.dumps(content, indent=1) + "\n"
