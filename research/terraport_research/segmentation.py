"""``terraport evaluate segmentation``: algorithms against people, on Princeton's models."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.progress import NullProgress, Progress
from terraport_research.cutters import CUTTERS, Body, Cutter
from terraport_research.options import Mode, SegmentationOptions
from terraport_research.princeton import Model, read_benchmark
from terraport_research.procedural_bodies import WAISTS, procedural_models
from terraport_research.segmentation_scores import METRICS, MeshFacts, Pieces, compare
from terraport_research.versions import versions_of_this

__all__ = [
    "PEOPLE",
    "ModelScores",
    "Row",
    "SegmentationEvaluation",
    "evaluate_segmentation",
    "score_model",
]

PEOPLE: Final = "people"
"""Row of people against people: every segmentation of a model against all others of it."""

_AHEAD: Final = 2
"""Models read while each worker is busy with one."""


@dataclass(frozen=True, slots=True)
class ModelScores:
    """One algorithm (or people) on one model."""

    algorithm: str
    number: int
    category: str
    faces: int
    scores: tuple[float, ...] | None
    """In the order of :data:`METRICS`, means over people; CD NaN where no pair had two cuts. None
    where the algorithm failed."""
    pairs: int
    """Pairs of segmentations that were compared."""
    no_cut: int
    """Of these, those of which one side had no cut: left out of CD."""
    segments: float
    """Edge-connected segments made, mean over the numbers asked for."""
    cpu_s: float
    error: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """Means of one algorithm over models."""

    algorithm: str
    models: int
    failed: int
    """Models that it could not cut; they are in no mean."""
    scores: tuple[float, ...]
    no_cut: int
    segments: float
    cpu_s: float
    """Of all models together."""


@dataclass(frozen=True, slots=True, eq=False)
class SegmentationEvaluation:
    """Scores of all algorithms on all models, and what they were made with."""

    options: SegmentationOptions
    results: tuple[ModelScores, ...]
    versions: dict[str, str]
    """``terraport``, ``commit``, libraries, machine."""
    metrics_cpu_s: float
    """Processor time of splitting and comparing alone, all algorithms and people."""
    wall_s: float

    @property
    def algorithms(self) -> tuple[str, ...]:
        """People first, then as asked."""
        return (PEOPLE, *self.options.algorithms)

    @property
    def categories(self) -> tuple[str, ...]:
        """In the order of the models."""
        return tuple(dict.fromkeys(one.category for one in self.results))

    def row(self, algorithm: str, category: str | None = None) -> Row:
        """Average an algorithm over the models, of one category or of all."""
        wanted = [
            one
            for one in self.results
            if one.algorithm == algorithm and category in (None, one.category)
        ]
        done = [one for one in wanted if one.scores is not None]
        table = np.array([one.scores for one in done], np.float64).reshape(-1, len(METRICS))
        return Row(
            algorithm,
            len(done),
            len(wanted) - len(done),
            tuple(map(float, _means(table))),
            sum(one.no_cut for one in done),
            float(np.mean([one.segments for one in done])) if done else float("nan"),
            sum(one.cpu_s for one in wanted),
        )


def evaluate_segmentation(
    options: SegmentationOptions, progress: Progress | None = None
) -> SegmentationEvaluation:
    """Cut models by algorithms and score them against people.

    Parameters
    ----------
    options : SegmentationOptions
    progress : Progress, optional
        Advances by models.

    Returns
    -------
    SegmentationEvaluation
        What an algorithm fails at is part of the result.

    Raises
    ------
    SurveyError
        The models are not there, or damaged.
    """
    watcher = progress or NullProgress()
    start = time.perf_counter()
    versions = versions_of_this()  # of the code that runs: a checkout may change meanwhile
    if options.models is None:
        models, count = procedural_models(), len(WAISTS)
    else:
        benchmark = read_benchmark(options.models)
        numbers = benchmark.numbers[:: options.every]
        models, count = benchmark.models(numbers), len(numbers)
    watcher.start("models", float(count), "models")
    results: list[ModelScores] = []
    metrics_cpu_s = 0.0
    for scored, seconds in _scored(
        models, options, min(options.threads or os.cpu_count() or 1, count)
    ):
        results += scored
        metrics_cpu_s += seconds
        watcher.advance(1)
    watcher.done({"models": count})
    results.sort(key=lambda one: one.number)
    return SegmentationEvaluation(
        options, tuple(results), versions, metrics_cpu_s, time.perf_counter() - start
    )


def _scored(
    models: Iterator[Model], options: SegmentationOptions, workers: int
) -> Iterator[tuple[list[ModelScores], float]]:
    """Score models, several at once; few are held ahead."""
    if workers == 1:
        for model in models:
            yield score_model(model, options)
        return
    # Kernels are compiled in the workers: a fork of a process with threads may hang.
    context = multiprocessing.get_context("forkserver")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        waiting: list[Future[tuple[list[ModelScores], float]]] = []
        for model in models:
            waiting.append(pool.submit(score_model, model, options))
            if len(waiting) >= _AHEAD * workers:
                yield waiting.pop(0).result()
        for future in waiting:
            yield future.result()


def score_model(model: Model, options: SegmentationOptions) -> tuple[list[ModelScores], float]:
    """Cut one model by every algorithm and compare; the seconds are those of the metrics alone."""
    start = time.process_time()
    mesh = MeshFacts.of(model.vertices, model.faces)
    people = [mesh.split(labels) for labels in model.people]
    others = [(a, b) for i, a in enumerate(people) for j, b in enumerate(people) if i != j]
    rows = [_people(model, mesh, people, others)]
    metrics_s = time.process_time() - start
    body = Body(model.vertices, model.faces, options.seed)
    for key in options.algorithms:
        row, seconds = _cut_and_score(CUTTERS[key], body, model, mesh, people, options.mode)
        rows.append(row)
        metrics_s += seconds
    return rows, metrics_s


def _people(
    model: Model, mesh: MeshFacts, people: list[Pieces], pairs: list[tuple[Pieces, Pieces]]
) -> ModelScores:
    table = np.array([compare(mesh, a, b) for a, b in pairs]).reshape(-1, len(METRICS))
    return ModelScores(
        PEOPLE,
        model.number,
        model.category,
        len(model.faces),
        tuple(map(float, _means(table))) if pairs else None,
        len(pairs),
        int(np.isnan(table[:, 0]).sum()),
        float(np.mean([one.count for one in people])),
        0.0,
        "" if pairs else "one person alone",
    )


def _cut_and_score(
    cutter: Cutter,
    body: Body,
    model: Model,
    mesh: MeshFacts,
    people: list[Pieces],
    mode: Mode,
) -> tuple[ModelScores, float]:
    """Run an algorithm for every number that is asked for, and compare it with each person."""
    counts = model.counts(mode)
    start = time.process_time()
    about = (cutter.key, model.number, model.category, len(model.faces))
    try:
        cut = cutter.prepare(body)
        labels = {k: cut(k) for k in dict.fromkeys(counts)}
    except Exception as error:  # noqa: BLE001  an algorithm that fails is a result
        spent = time.process_time() - start
        told = f"{type(error).__name__}: {error}"
        return ModelScores(*about, None, 0, 0, float("nan"), spent, told), 0.0
    spent = time.process_time() - start
    start = time.process_time()
    pieces = {k: mesh.split(one) for k, one in labels.items()}
    table = np.array(
        [compare(mesh, pieces[k], person) for k, person in zip(counts, people, strict=True)]
    )
    scores = tuple(map(float, _means(table)))
    made = float(np.mean([pieces[k].count for k in counts]))
    no_cut = int(np.isnan(table[:, 0]).sum())
    row = ModelScores(*about, scores, len(people), no_cut, made, spent)
    return row, time.process_time() - start


def _means(table: Float64) -> Float64:
    """Mean of every column without NaN; NaN where there is nothing else."""
    there = np.isfinite(table)
    count = there.sum(axis=0)
    total = np.where(there, table, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def options_as_json(options: SegmentationOptions) -> dict[str, Any]:
    """Say what was asked, without paths of this machine."""
    return {
        "models": "procedural" if options.models is None else options.models.name,
        "algorithms": list(options.algorithms),
        "mode": options.mode,
        "every": options.every,
        "seed": options.seed,
    }
