"""``terraport evaluate segmentation``: rows, failures, means, pages, options."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from terraport_pipeline.errors import EngineError
from terraport_research.cli import register
from terraport_research.cutters import CUTTERS
from terraport_research.options import SegmentationOptions
from terraport_research.procedural_bodies import procedural_models
from terraport_research.segmentation import PEOPLE, evaluate_segmentation, score_model
from terraport_research.segmentation_page import to_json, to_markdown
from terraport_research.segmentation_scores import METRICS, MeshFacts, compare
from terraport_research.thesis_tables import THESIS_COLUMNS, THESIS_TABLES
from terraport_research.versions import commit_of_this

OPTIONS = SegmentationOptions(algorithms=("graph", "automatic"), threads=1)


def run(*arguments: object, columns: int = 160):
    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    words = ["evaluate", "segmentation", *map(str, arguments)]
    return CliRunner().invoke(app, words, env={"COLUMNS": str(columns)})


def test_files_of_the_whole_command(tmp_path: Path) -> None:
    words = ("-o", tmp_path / "out", "--algorithms", "graph,automatic", "--threads", 1)
    result = run(*words, columns=40)
    assert result.exit_code == 0, result.output
    document = json.loads((tmp_path / "out/segmentation.json").read_text())
    assert set(document["algorithms"]) == {"people", "graph", "automatic"}
    for row in document["algorithms"].values():
        assert {"mode", "seed", "terraport", "commit"} <= set(row)
    with (tmp_path / "out/segmentation.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * (1 + 4)  # all, and each body's category
    [row] = [one for one in rows if (one["algorithm"], one["category"]) == ("graph", "all")]
    assert float(row["ri"]) == document["algorithms"]["graph"]["ri"]
    assert (row["mode"], row["seed"]) == ("by-model", "0")
    page = (tmp_path / "out/segmentation.html").read_text()
    assert "http" not in page
    assert page.count("seed 0") >= 1 + len(METRICS)
    text = (tmp_path / "out/segmentation.md").read_text()
    assert text.count("\n## ") == len(METRICS)
    # Every figure is printed whole, however narrow the terminal or the pipe.
    assert "…" not in result.output
    [line] = [one for one in result.output.splitlines() if one.split()[:1] == ["graph"]]
    scores = [document["algorithms"]["graph"][metric] for metric in METRICS]
    assert line.split()[1:8] == [f"{score:.3f}" for score in scores]


def test_people_against_people_are_all_ordered_pairs() -> None:
    model = next(procedural_models())
    [people], _ = score_model(model, replace(OPTIONS, algorithms=()))
    mesh = MeshFacts.of(model.vertices, model.faces)
    a, b = (mesh.split(labels) for labels in model.people)
    expected = np.mean([compare(mesh, a, b), compare(mesh, b, a)], axis=0)
    assert (people.algorithm, people.pairs) == (PEOPLE, 2)
    assert people.scores == pytest.approx(tuple(expected))
    assert people.scores[2] == pytest.approx(people.scores[3])  # both ways: Rm is Rf


def test_k_is_told_by_the_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def prepare(body):
        def cut(k):
            asked.append(k)
            return np.zeros(len(body.faces), np.int32)

        return cut

    monkeypatch.setitem(CUTTERS, "graph", replace(CUTTERS["graph"], prepare=prepare))
    model = next(procedural_models())
    for mode, expected in (
        ("by-segmentation", [3, 2]), ("by-model", [3]), ("by-category", [3]), ("by-dataset", [7]),
    ):  # fmt: skip
        asked.clear()
        rows, _ = score_model(model, replace(OPTIONS, algorithms=("graph",), mode=mode))
        assert asked == expected  # each number once
        # One segment has no cut: CD is nobody's, and the pairs are counted.
        assert np.isnan(rows[1].scores[0])
        assert rows[1].no_cut == rows[1].pairs == 2


def test_a_failure_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    def prepare(body):
        raise EngineError("too round")

    monkeypatch.setitem(CUTTERS, "graph", replace(CUTTERS["graph"], prepare=prepare))
    evaluation = evaluate_segmentation(OPTIONS)
    row = evaluation.row("graph")
    assert (row.models, row.failed) == (0, 4)
    assert evaluation.row("automatic").failed == 0
    assert "too round" in to_markdown(evaluation)
    assert json.loads(to_json(evaluation))["algorithms"]["graph"]["ri"] is None


def test_means_are_over_models_without_what_is_undefined() -> None:
    evaluation = evaluate_segmentation(replace(OPTIONS, algorithms=()))
    results = [
        replace(evaluation.results[0], scores=(value, 0.5, 0.5, 0.5, value, 0.0, 0.0))
        for value in (0.1, 0.3)
    ]
    results.append(replace(results[0], scores=(float("nan"), *results[0].scores[1:])))
    row = replace(evaluation, results=tuple(results)).row(PEOPLE)
    assert row.scores[0] == pytest.approx(0.2)
    assert row.scores[4] == pytest.approx(0.5 / 3)


def test_the_thesis_tables_are_whole() -> None:
    """The averages that the thesis prints are those of its rows, to its rounding."""
    assert tuple(THESIS_TABLES) == METRICS
    for metric, table in THESIS_TABLES.items():
        for column in THESIS_COLUMNS:
            rows = [row[column] for name, row in table.items() if name != "Average"]
            assert len(rows) == 19
            # Core Extraction cut 353 of 380 models: categories do not weigh alike.
            apart = 0.02 if column == "COE" else 0.002
            assert table["Average"][column] == pytest.approx(np.mean(rows), abs=apart), metric


def test_the_commit_is_of_the_checkout() -> None:
    assert commit_of_this()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--algorithms", "magic"), "algorithm 'magic'; expected one of automatic"),
        (("--mode", "told"), "mode 'told'; expected by-segmentation"),
        (("--models", "/nowhere"), "/nowhere is not there"),
    ],
)
def test_what_is_refused(tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    result = run("-o", tmp_path / "out", *arguments)
    assert result.exit_code in (1, 2)
    assert message in " ".join(result.output.split())
    assert not (tmp_path / "out").exists()
