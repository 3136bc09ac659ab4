"""``terraport evaluate thesis``: pieces, pages, what is left out."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from terraport_pipeline.errors import OptionError, SurveyError
from terraport_pipeline.geometry.mesh.adjacency import components
from terraport_pipeline.geometry.mesh.mesh_edges import edge_facts
from terraport_pipeline.progress import NullProgress
from terraport_research.cli import register
from terraport_research.options import SegmentationOptions, ThesisOptions
from terraport_research.segmentation import evaluate_segmentation
from terraport_research.segmentation_page import to_json
from terraport_research.thesis import landscapes, pieces, pools, run_times
from terraport_research.thesis.bodies import make_bodies
from terraport_research.thesis.evaluate import evaluate_thesis
from terraport_research.thesis.people import make_people
from terraport_research.thesis_tables import THESIS_TABLES

OPTIONS = ThesisOptions(algorithms=("tpa", "automatic"), most_faces=49_000)


@pytest.fixture(scope="module")
def coarse_pieces() -> tuple[pieces.Piece, ...]:
    edge = pieces._EDGE_M
    pieces._EDGE_M = 6.0  # type: ignore[misc]
    try:
        return pieces.thesis_pieces(0)
    finally:
        pieces._EDGE_M = edge  # type: ignore[misc]


@pytest.fixture(scope="module")
def scores(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scores") / "segmentation.json"
    path.write_text(
        to_json(evaluate_segmentation(SegmentationOptions(algorithms=("tpa",), threads=1, seed=3)))
    )
    return path


def test_people_come_from_the_results_file_alone(scores: Path) -> None:
    page = make_people(scores).page
    document = json.loads(scores.read_text())
    tables = {table.key: table for table in page.tables}
    assert {"B.1", "B.7", "5.12a", "5.12b", "5.12c", "5.12d"} <= set(tables)
    rows = {row.title: row for row in tables["5.12c"].rows}
    tpa = rows["Triangle Pool Algorithm"]
    assert tpa.values[0] == pytest.approx(document["algorithms"]["tpa"]["ri"], abs=1e-5)
    assert tpa.thesis == ()  # bodies made here are not the thesis's
    assert (page.stamp.seed, page.stamp.mode) == (3, "by-model")


def test_people_of_princeton_stand_beside_the_thesis(scores: Path, tmp_path: Path) -> None:
    document = json.loads(scores.read_text())
    document["options"]["models"] = "psb"
    for one in document["models"]:
        one["category"] = "Hand"
    path = tmp_path / "psb.json"
    path.write_text(json.dumps(document))
    tables = {table.key: table for table in make_people(path).page.tables}
    hand, average = tables["B.5"].rows
    assert hand.thesis == (
        THESIS_TABLES["ri"]["Hand"]["Bench"],
        THESIS_TABLES["ri"]["Hand"]["TPA"],
    )
    assert average.title == "Average"


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"options": {}}'])
def test_what_is_no_results_file_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "segmentation.json"
    path.write_text(text)
    with pytest.raises(SurveyError, match="segmentation"):
        make_people(path)


def test_pieces_have_a_truth_worth_finding(coarse_pieces: tuple[pieces.Piece, ...]) -> None:
    for piece in coarse_pieces:
        share = np.bincount(piece.regions) / len(piece.faces)
        assert len(share) >= 3
        assert components(len(piece.faces), piece.pairs[0])[1] == 1
        assert share.max() < 0.9
        assert np.ptp(piece.vertices[:, 0]) < 140.0


def test_a_closed_piece_is_closed_and_keeps_its_faces(
    coarse_pieces: tuple[pieces.Piece, ...],
) -> None:
    piece = coarse_pieces[2]
    vertices, faces = pieces.closed_below(piece)
    np.testing.assert_array_equal(faces[: len(piece.faces)], piece.faces)
    assert len(edge_facts(faces).open_edges) == 0
    # Outwards: of a body the volume under its faces is positive.
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    assert np.einsum("ij,ij->", np.cross(a, b), c) > 0


def test_landscapes_score_every_algorithm(
    coarse_pieces: tuple[pieces.Piece, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(landscapes, "thesis_pieces", lambda seed: coarse_pieces)
    made = landscapes.make_landscapes(OPTIONS, NullProgress())
    assert [table.key for table in made.page.tables] == ["5.1", "5.2", "5.3"]
    first, *_, last = made.page.tables[0].rows
    assert first.thesis == (0.017, None)
    assert last.title == "All one region"
    assert all(row.note == "" for table in made.page.tables for row in table.rows)
    shown = [picture.name for figure in made.page.figures for picture in figure.pictures]
    assert set(shown) == set(made.pictures)


def test_an_algorithm_that_fails_is_a_row(
    coarse_pieces: tuple[pieces.Piece, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(piece: pieces.Piece) -> None:
        raise RuntimeError("no such luck")

    monkeypatch.setattr(landscapes, "thesis_pieces", lambda seed: coarse_pieces[:1])
    monkeypatch.setattr(landscapes, "_cuts", lambda options: [("Bad", "FP", fails)])
    page = landscapes.make_landscapes(OPTIONS, NullProgress()).page
    assert page.tables[0].rows[0].values == (None, None)
    assert page.tables[0].rows[0].thesis == (0.121, None)
    assert "no such luck" in page.tables[0].rows[0].note


def test_pools_grow_in_number_as_the_threshold_falls(
    coarse_pieces: tuple[pieces.Piece, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pools, "thesis_pieces", lambda seed: coarse_pieces)
    page = pools.make_pools(OPTIONS, NullProgress()).page
    assert [table.key for table in page.tables] == ["5.18", "5.19", "5.20"]
    for table in page.tables:
        counts = [row.values[1] for row in table.rows]
        assert counts == sorted(counts)
        assert counts[-1] > counts[0]


def test_run_times_are_of_the_thesis_sizes() -> None:
    page = run_times.make_run_times(OPTIONS, NullProgress()).page
    [row] = page.tables[0].rows
    assert row.title == "49,000 faces"
    assert row.thesis[:2] == pytest.approx((180.0, 28.8))
    vertices, faces, colours = run_times.coloured_ground(9_999, 0)
    assert len(faces) == 9_999
    assert faces.max() < len(vertices) == len(colours)
    again = run_times.coloured_ground(9_999, 0)
    np.testing.assert_array_equal(colours, again[2])


def test_bodies_show_original_algorithms_and_one_person() -> None:
    made = make_bodies(replace(OPTIONS, algorithms=("automatic",)), NullProgress())
    titles = [picture.title for picture in made.page.figures[0].pictures]
    assert titles == ["Original", "Graph, automatic", "One person"]
    assert all(data.startswith(b"\xff\xd8") for data in made.pictures.values())


def test_pages_made_before_stay(scores: Path, tmp_path: Path) -> None:
    options = replace(OPTIONS, pages=("people",), scores=scores)
    pages, left_out = evaluate_thesis(options, tmp_path)
    assert ([page.key for page in pages], left_out) == (["people"], [])
    pages, _ = evaluate_thesis(replace(OPTIONS, pages=("run-times",)), tmp_path)
    assert [page.key for page in pages] == ["people", "run-times"]
    before = (tmp_path / "thesis.html").read_text()
    evaluate_thesis(replace(OPTIONS, pages=()), tmp_path)
    assert (tmp_path / "thesis.html").read_text() == before
    with (tmp_path / "thesis.csv").open() as file:
        assert {row["page"] for row in csv.DictReader(file)} == {"people", "run-times"}


def test_a_page_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    pages, left_out = evaluate_thesis(replace(OPTIONS, pages=("people",)), tmp_path)
    assert pages == []
    [reason] = left_out
    assert "run terraport evaluate segmentation first" in reason


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"pages": ("tables",)}, "page 'tables'; expected some of people"),
        ({"algorithms": ("magic",)}, "algorithm 'magic'"),
        ({"depths": (3,)}, "depth 3; expected 4 to 14"),
    ],
)
def test_wrong_options_are_refused(words: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        replace(OPTIONS, **words)


def test_the_command_writes_all_forms(tmp_path: Path) -> None:
    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    words = ["evaluate", "thesis", "--pages", "run-times", "--most-faces", "49k"]
    result = CliRunner().invoke(app, [*words, "-o", str(tmp_path)], env={"COLUMNS": "160"})
    assert result.exit_code == 0, result.output
    assert "Table 5.4: 1 tables, 0 figures" in result.output
    for ending in ("html", "md", "csv", "json"):
        assert "seed" in (tmp_path / f"thesis.{ending}").read_text()
