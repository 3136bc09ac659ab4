"""Figures 5.13, 5.14 and C.1 to C.9: bodies as each algorithm, and one person, cut them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from terraport_pipeline.progress import Progress
from terraport_research.booklet_model import Column, Row, Table
from terraport_research.cutters import CUTTERS, Body
from terraport_research.options import ThesisOptions
from terraport_research.princeton import Model, read_benchmark
from terraport_research.procedural_bodies import WAISTS, procedural_models
from terraport_research.segmentation_scores import MeshFacts, compare
from terraport_research.thesis.making import Made, Making, labelled_picture, plain_picture, view_of

__all__ = ["make_bodies"]

KEY: Final = "bodies"
_FIGURES: Final = {
    "Hand": "5.13", "Ant": "5.14", "Human": "C.1", "Glasses": "C.2", "Airplane": "C.3",
    "Octopus": "C.4", "Armadillo": "C.5", "Bust": "C.6", "Bearing": "C.7", "Vase": "C.8",
    "FourLeg": "C.9",
}  # fmt: skip
"""The kind of body that each of the thesis's figures shows; which model it was, it does not say."""


def make_bodies(options: ThesisOptions, progress: Progress) -> Made:
    """Cut one model of each kind and draw it.

    Raises
    ------
    SurveyError
        The models are not there, or damaged.
    """
    origin = "procedural" if options.models is None else options.models.name
    mode = f"{options.mode}, models {origin}"
    making = Making(KEY, "Bodies: Figures 5.13, 5.14, C.1 to C.9", mode, options.seed)
    making.say(
        "The first model of each kind that is there; the thesis does not say which it shows. "
        "A colour is a segment; colours of different pictures have nothing to do with each other."
    )
    models = _models(options)
    progress.start("bodies", float(len(_FIGURES) if options.models else len(WAISTS)), "bodies")
    rows = []
    for figure, model in models:
        rows.append(_draw(making, figure, model, options))
        progress.advance(1)
    progress.done({"bodies": len(rows)})
    columns = tuple(Column(key, CUTTERS[key].title) for key in options.algorithms)
    title = "1 - RI of the pictures, against all people"
    making.tables.append(Table("bodies", title, "model", columns, tuple(rows)))
    return making.made()


def _models(options: ThesisOptions) -> Iterator[tuple[str, Model]]:
    if options.models is None:
        for model in procedural_models():
            yield model.category, model
        return
    benchmark = read_benchmark(options.models)
    firsts: dict[str, int] = {}
    for number in benchmark.numbers:
        firsts.setdefault(benchmark.category(number), number)
    # One pass over what may be an archive, then in the thesis's order.
    wanted = tuple(sorted(number for kind, number in firsts.items() if kind in _FIGURES))
    by_kind = {model.category: model for model in benchmark.models(wanted)}
    for kind, figure in _FIGURES.items():
        if kind in by_kind:
            yield figure, by_kind[kind]


def _draw(making: Making, figure: str, model: Model, options: ThesisOptions) -> Row:
    """Add a figure; return its row of 1 - RI."""
    body = Body(model.vertices, model.faces, options.seed)
    mesh = MeshFacts.of(model.vertices, model.faces)
    vertices, faces = body.vertices32, body.faces
    camera = view_of(vertices, is_body=True)
    pictures: list[tuple[str, str, bytes | None]] = [
        ("Original", f"model {model.number}, {len(faces):,} faces",
         plain_picture(vertices, faces, camera))
    ]  # fmt: skip
    values: list[float | None] = []
    k = model.counts(options.mode)[0]
    for key in options.algorithms:
        cutter = CUTTERS[key]
        try:
            labels = cutter.prepare(body)(k)
        except Exception as error:  # noqa: BLE001  an algorithm that fails is a result
            pictures.append((cutter.title, f"failed: {error}", None))
            values.append(None)
            continue
        pieces = mesh.split(labels)
        scores = [compare(mesh, pieces, mesh.split(person)).ri for person in model.people]
        values.append(sum(scores) / len(scores))
        told = f", told {k}" if cutter.takes_k else ""
        words = f"{pieces.count} segments{told}, 1 - RI {values[-1]:.3f}"
        pictures.append(
            (cutter.title, words, labelled_picture(vertices, faces, camera, pieces.labels))
        )
    person = mesh.split(model.people[0])
    pictures.append(
        ("One person", f"{person.count} segments",
         labelled_picture(vertices, faces, camera, person.labels))
    )  # fmt: skip
    name = f"Figure {figure}" if figure in _FIGURES.values() else "A body made here"
    making.figure(figure, f"{name}: {model.category}", pictures)
    return Row(f"{model.category}, model {model.number}", tuple(values))
