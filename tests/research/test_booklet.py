"""Pages as values, and the one writer of all of them."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pytest

from terraport_pipeline.errors import SurveyError
from terraport_research.booklet import Booklet, read_pages, to_csv, to_markdown, write_pages
from terraport_research.booklet_model import (
    Column,
    Figure,
    Page,
    Picture,
    Row,
    Stamp,
    Table,
    page_from_json,
)

BOOKLET = Booklet("book", "terraport evaluate book", "A book", "In brackets: the thesis.")
STAMP = Stamp("0.1", "abc123+", "by-model", 5, "a machine", 1.5)
TABLE = Table(
    "5.1",
    "Table 5.1",
    "algorithm",
    (Column("ri", "1 - RI"), Column("segments", "segments", 0)),
    (
        Row("TPA <&>", (0.25, 12345.0), (0.017, None)),
        Row("SD", (float("nan"), None), note="failed: no | ray"),
    ),
    "columns",
)
PAGE = Page(
    "one", "One page", ("Words.",), (TABLE,), (Figure("f", "F", (Picture("a.jpg", "A"),)),), STAMP
)


def test_a_page_is_kept_as_json_whole() -> None:
    kept = page_from_json(json.loads(json.dumps(PAGE.to_json(), allow_nan=False)))
    assert kept.tables[0].rows[0] == TABLE.rows[0]
    assert kept.tables[0].rows[1].values == (None, None)  # NaN is none
    assert (kept.stamp, kept.figures, kept.text) == (PAGE.stamp, PAGE.figures, PAGE.text)


@pytest.mark.parametrize("document", [{}, {"form": 2}, {"form": 1, "key": "x"}])
def test_another_form_is_refused(document: dict[str, object]) -> None:
    with pytest.raises(SurveyError, match="make it again"):
        page_from_json(document)


def test_every_number_of_the_csv_has_its_stamp() -> None:
    rows = list(csv.DictReader(io.StringIO(to_csv([PAGE]))))
    assert len(rows) == 4
    assert {(r["terraport"], r["commit"], r["mode"], r["seed"]) for r in rows} == {
        ("0.1", "abc123+", "by-model", "5")
    }
    assert (rows[0]["value"], rows[0]["thesis"]) == ("0.25", "0.017")
    assert (rows[2]["value"], rows[2]["note"]) == ("", "failed: no | ray")


def test_markdown_shows_the_thesis_in_brackets() -> None:
    text = to_markdown([PAGE], BOOKLET)
    assert "0.250 (0.017)" in text
    assert "12,345" in text
    assert r"no \| ray" in text  # a table stays a table
    assert "commit abc123+, mode by-model, seed 5" in text


def test_a_folder_is_written_again_from_its_results(tmp_path: Path) -> None:
    write_pages([PAGE], {"a.jpg": b"\xff\xd8picture"}, tmp_path, BOOKLET)
    page = (tmp_path / "book.html").read_text()
    assert "TPA &lt;&amp;&gt;" in page
    assert "data:image/jpeg;base64,/9hwaWN0dXJl" in page
    assert 'src="http' not in page
    (tmp_path / "book.html").unlink()
    pages = read_pages(tmp_path, BOOKLET)
    write_pages(list(pages.values()), {}, tmp_path, BOOKLET)
    assert (tmp_path / "book.html").read_text() == page


def test_a_missing_picture_leaves_its_name(tmp_path: Path) -> None:
    write_pages([PAGE], {}, tmp_path, BOOKLET)
    assert "a.jpg is not there" in (tmp_path / "book.html").read_text()


def test_damaged_results_are_refused(tmp_path: Path) -> None:
    (tmp_path / "book.json").write_text("[]")
    with pytest.raises(SurveyError, match=r"book\.json is no results file"):
        read_pages(tmp_path, BOOKLET)
