"""How likely two neighbouring parts of a body are one to people: fitted on Princeton's models.

Pieces of every model are united step by step; all neighbours met on the way are rows, with their
facts and the share of people's face pairs across them that lie in one segment. A logistic function
is fitted to these rows: first along an order that follows people (with noise), then also along the
order of its own first fit, so that it knows the parts that it makes itself. Rows weigh by the root
of the face pairs that the decision moves.

Fitted on every fourth of the models alone; the threshold is chosen on these too, each quarter of
them by weights of the other three. The page and the results report on the rest.

    python benchmarks/part_likelihood.py --models psb_odd_models.tar.xz            # look
    python benchmarks/part_likelihood.py --models psb_odd_models.tar.xz --write    # and keep
    python benchmarks/part_likelihood.py --smoke
"""

from __future__ import annotations

import argparse
import json
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import Float64, Int32
from terraport_pipeline.engines.body_parts import base_pieces, body_facts
from terraport_pipeline.engines.shape_diameter import shape_diameter
from terraport_pipeline.geometry.graph import part_merge
from terraport_pipeline.geometry.graph.part_merge import PartWeights, fact_names, merge_parts
from terraport_pipeline.geometry.graph.part_table import BodyFacts, PartTable
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh
from terraport_research.cutters import Body
from terraport_research.princeton import Model, read_benchmark
from terraport_research.procedural_bodies import procedural_models
from terraport_research.segmentation_scores import METRICS, MeshFacts, Pieces, compare

EVERY: Final = 4
THRESHOLDS: Final = (0.3, 0.35, 0.4, 0.45, 0.5, 0.55)
ORDER_NOISE: Final = (0.15, 0.05)
"""Of likelihoods, by lot, along people's order and along the fit's own."""
RIDGE: Final = 1e-4
NEWTON_STEPS: Final = 8

Rows = tuple[Float64, Float64, Float64]
"""Facts (N, D), share of people (N,), weight (N,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A model, measured once."""

    mesh: MeshFacts
    people: list[Pieces]
    k: int
    facts: BodyFacts
    labels: Int32
    count: int

    @classmethod
    def of(cls, model: Model) -> Subject:
        """Measure a model as a build does."""
        body = Body(model.vertices, model.faces)
        mesh = SegmenterMesh(body.vertices32, body.faces, pairs=body.neighbours)
        labels, count = base_pieces(mesh)
        facts = body_facts(mesh, shape_diameter(mesh.vertices, mesh.faces))
        scored = MeshFacts.of(model.vertices, model.faces)
        people = [scored.split(one) for one in model.people]
        return cls(scored, people, model.k_by_model, facts, labels, count)

    def together(self) -> Float64:
        """Pairs of faces, mean over people, that lie in two pieces and in one segment."""
        total = np.zeros((self.count, self.count))
        for person in self.people:
            table = np.zeros((self.count, person.count))
            np.add.at(table, (self.labels, person.labels), 1.0)
            total += table @ table.T
        return total / len(self.people)

    def score(self, labels: Int32) -> Float64:
        """Measures, means over people, and the number of segments."""
        pieces = self.mesh.split(labels)
        table = np.array([compare(self.mesh, pieces, person) for person in self.people])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # no cut at all
            return np.append(np.nanmean(table, axis=0), pieces.count)


def rows_along(subject: Subject, weights: PartWeights | None, rng: np.random.Generator) -> Rows:
    """Unite all pieces, by people's order or a fit's, and note all neighbours at every step."""
    table = PartTable(subject.facts, subject.labels, subject.count)
    together = subject.together()
    faces = np.bincount(subject.labels, minlength=subject.count).astype(np.float64)
    noted: list[Rows] = []
    noise = ORDER_NOISE[0 if weights is None else 1]
    while True:
        small, large = table.neighbours()
        if len(small) == 0:
            break
        facts = table.facts(small, large)
        pairs = faces[small] * faces[large]
        share = together[small, large] / pairs
        noted.append((facts, share, np.sqrt(pairs) / len(subject.labels)))
        order = share if weights is None else weights.likelihood(facts)
        best = int(np.argmax(order + noise * rng.standard_normal(len(order))))
        kept, gone = int(large[best]), int(small[best])
        table.merge(kept, gone)
        faces[kept] += faces[gone]
        together[kept] += together[gone]
        together[:, kept] += together[:, gone]
    return stacked(noted)


def stacked(parts: list[Rows]) -> Rows:
    facts, share, weight = (np.concatenate(column) for column in zip(*parts, strict=True))
    return facts, share, weight


def fit(rows: Rows) -> PartWeights:
    """Fit by Newton's method; the ridge keeps facts that go together from running off."""
    facts, share, weight = rows
    mean, deviation = facts.mean(axis=0), facts.std(axis=0) + 1e-9
    far = np.clip((facts - mean) / deviation, -4.0, 4.0)
    far = np.concatenate([far, np.ones((len(far), 1))], axis=1)
    weight = weight / weight.sum()
    value = np.zeros(far.shape[1])
    for _ in range(NEWTON_STEPS):
        likely = 1.0 / (1.0 + np.exp(-(far @ value)))
        gradient = far.T @ (weight * (likely - share)) + RIDGE * value
        bent = weight * np.maximum(likely * (1.0 - likely), 1e-6)
        curvature = (far * bent[:, None]).T @ far + RIDGE * np.eye(len(value))
        value = value - np.linalg.solve(curvature, gradient)
    return PartWeights(mean, deviation, value[:-1], float(value[-1]))


def fit_all(subjects: list[Subject], people: list[Rows], rng: np.random.Generator) -> PartWeights:
    """Fit along people's order, then along both that and its own."""
    first = fit(stacked(people))
    return fit(stacked(people + [rows_along(one, first, rng) for one in subjects]))


def judge(subjects: list[Subject], weights: PartWeights) -> tuple[Float64, Float64]:
    """Scores (N, thresholds, metrics + 1), and (N, metrics + 1) told k."""
    automatic, told = [], []
    for one in subjects:
        merges = merge_parts(one.facts, one.labels, one.count, weights)
        automatic.append([one.score(merges.cut_by_likelihood(t)[0]) for t in THRESHOLDS])
        told.append(one.score(merges.cut_by_count(one.k)[0]))
    return np.array(automatic), np.array(told)


def show(title: str, automatic: Float64, told: Float64) -> None:
    names = [*METRICS, "segments", "<= 20"]
    print(f"\n{title}\n\n| threshold | {' | '.join(names)} |\n| -- |{' -- |' * len(names)}")
    rows = [(f"{t:g}", automatic[:, i]) for i, t in enumerate(THRESHOLDS)]
    for name, scores in [*rows, ("told k", told)]:
        values = [f"{value:.3f}" for value in np.nanmean(scores, axis=0)]
        few = f"{np.mean(scores[:, -1] <= 20):.0%}"
        print(f"| {name} | {' | '.join(values)} | {few} |", flush=True)


def keep(weights: PartWeights) -> None:
    rows = zip(fact_names(), weights.mean, weights.deviation, weights.weight, strict=True)
    table = {
        "facts": {name: [float(f"{v:.5g}") for v in values] for name, *values in rows},
        "bias": round(weights.bias, 5),
    }
    lines = json.dumps(table, indent=1).replace("[\n   ", "[").replace(",\n   ", ", ")
    path = Path(part_merge.__file__).with_name("part_weights.json")
    path.write_text(lines.replace("\n  ]", "]") + "\n", "utf-8")
    print(f"\nwritten: {path.name}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--models", type=Path, help="Princeton's models, a folder or archive")
    parser.add_argument("--write", action="store_true", help="keep the weights")
    parser.add_argument("--smoke", action="store_true", help="bodies made here; seconds")
    options = parser.parse_args()
    if options.smoke:
        models = list(procedural_models())
    elif options.models is None:
        parser.error("expected --models, or --smoke")
    else:
        benchmark = read_benchmark(options.models)
        models = list(benchmark.models(benchmark.numbers[::EVERY]))
    rng = np.random.default_rng(0)
    subjects = [Subject.of(model) for model in models]
    people = [rows_along(one, None, rng) for one in subjects]
    n = len(subjects)
    print(f"{n} models, {sum(len(one[1]) for one in people)} rows along people's order")
    automatic, told = [], []
    for fold in range(4):
        rest = [i for i in range(n) if i % 4 != fold]
        weights = fit_all([subjects[i] for i in rest], [people[i] for i in rest], rng)
        scores = judge([subjects[i] for i in range(n) if i % 4 == fold], weights)
        automatic.append(scores[0])
        told.append(scores[1])
    show("Each quarter by weights of the rest", np.concatenate(automatic), np.concatenate(told))
    weights = fit_all(subjects, people, rng)
    if options.write:
        keep(weights)


if __name__ == "__main__":
    main()
