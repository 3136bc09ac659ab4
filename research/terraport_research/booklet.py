"""The one writer of all pages: Markdown, CSV, JSON, and one HTML page with everything inside.

The JSON and the folder of pictures are the results; the rest is made of them and can be made again
without computing anything.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.errors import SurveyError
from terraport_pipeline.report.html_page import page_templates, replace_bytes, replace_page
from terraport_research.booklet_model import Page, Table, page_from_json

__all__ = ["Booklet", "read_pages", "to_csv", "to_html", "to_markdown", "write_pages"]

_PICTURES: Final = "pictures"
MAX_JSON_BYTES: Final = 64 << 20
"""Of a results file that is read again."""
_MEDIA_TYPES: Final = {
    ".jpg": "image/jpeg", ".png": "image/png", ".svg": "image/svg+xml",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Booklet:
    """What a set of pages is called."""

    name: str
    """Of its files, without their endings."""
    command: str
    title: str
    words: str
    """What brackets and grey bars mean, or what else a reader must know."""


def read_pages(folder: Path, booklet: Booklet) -> dict[str, Page]:
    """Read the pages that were made into a folder; none where there are none.

    Raises
    ------
    SurveyError
        The file is damaged, too large, or of another form.
    """
    path = folder / f"{booklet.name}.json"
    if not path.is_file():
        return {}
    if path.stat().st_size > MAX_JSON_BYTES:
        raise SurveyError(f"{path} has {path.stat().st_size:,} bytes; expected {MAX_JSON_BYTES:,}")
    try:
        documents = json.loads(path.read_text(encoding="utf-8"))["pages"]
    except (ValueError, KeyError, TypeError) as error:
        raise SurveyError(f"{path} is no results file ({error}); delete it") from error
    pages = [page_from_json(document) for document in documents]
    return {page.key: page for page in pages}


def write_pages(
    pages: Sequence[Page], pictures: Mapping[str, bytes], folder: Path, booklet: Booklet
) -> None:
    """Write pages into a folder: pictures first, then the results, then what is made of them."""
    (folder / _PICTURES).mkdir(parents=True, exist_ok=True)
    for name, data in pictures.items():
        replace_bytes(folder / _PICTURES / name, data)
    replace_page(folder / f"{booklet.name}.json", _to_json(pages))
    replace_page(folder / f"{booklet.name}.csv", to_csv(pages))
    replace_page(folder / f"{booklet.name}.md", to_markdown(pages, booklet))
    replace_page(folder / f"{booklet.name}.html", to_html(pages, folder / _PICTURES, booklet))


def _to_json(pages: Sequence[Page]) -> str:
    document = {"pages": [page.to_json() for page in pages]}
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def to_csv(pages: Sequence[Page]) -> str:
    """Write one line a number, each with its stamp."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(
        ["page", "table", "row", "column", "unit", "value", "thesis", "note",
         "terraport", "commit", "mode", "seed"]
    )  # fmt: skip
    for page in pages:
        stamp = page.stamp
        made_with = [stamp.terraport, stamp.commit, stamp.mode, stamp.seed]
        for table in page.tables:
            if table.only_bars:
                continue
            for row in table.rows:
                for number, column in enumerate(table.columns):
                    value = row.values[number]
                    thesis = row.thesis[number] if row.thesis else None
                    writer.writerow(
                        [page.key, table.key, row.title, column.key, column.unit,
                         *("" if v is None else f"{v:.6g}" for v in (value, thesis)),
                         row.note, *made_with]
                    )  # fmt: skip
    return out.getvalue()


def to_markdown(pages: Sequence[Page], booklet: Booklet) -> str:
    """Write tables, and the pictures by their files."""
    text = [f"# {booklet.title}", "", booklet.words, ""]
    for page in pages:
        text += [f"## {page.title}", "", *(f"{part}\n" for part in page.text)]
        for table in page.tables:
            if table.only_bars:
                continue
            notes = any(row.note for row in table.rows)
            heads = [table.head, *(_head(table, i) for i in range(len(table.columns)))]
            heads += ["note"] * notes
            text += [f"### {table.title}", "", f"{page.stamp.line}.", ""]
            text += [
                f"| {' | '.join(heads)} |",
                "| -- |" + " -: |" * len(table.columns) + " -- |" * notes,
            ]
            for row in table.rows:
                cells = [row.title, *(table.cell(row, i) for i in range(len(table.columns)))]
                cells += [row.note.replace("|", r"\|")] * notes
                text.append(f"| {' | '.join(cells)} |")
            text.append("")
        for figure in page.figures:
            text += [f"### {figure.title}", "", f"{page.stamp.line}.", ""]
            for picture in figure.pictures:
                words = f": {picture.words}" if picture.words else ""
                text += [
                    f"{picture.title}{words}",
                    "",
                    f"![{picture.title}](pictures/{picture.name})",
                    "",
                ]
    return "\n".join(text).rstrip() + "\n"


def to_html(pages: Sequence[Page], pictures: Path, booklet: Booklet) -> str:
    """Make the page; pictures are put into it. One that is not there leaves its name."""

    def data_of(name: str) -> bytes | None:
        path = pictures / Path(name).name
        return path.read_bytes() if path.is_file() else None

    return (
        page_templates("terraport_research")
        .get_template("booklet.html.j2")
        .render(
            booklet=booklet,
            pages=pages,
            head=_head,
            longest=_longest,
            data_of=data_of,
            media_type=lambda name: _MEDIA_TYPES[Path(name).suffix],
        )
    )


def _head(table: Table, column: int) -> str:
    one = table.columns[column]
    return f"{one.title}, {one.unit}" if one.unit else one.title


def _longest(rows: Sequence[Any], columns: Sequence[int]) -> float:
    """Length of the longest bar of a block."""
    values = [
        value
        for row in rows
        for side in (row.values, row.thesis)
        for number in columns
        if number < len(side) and (value := side[number]) is not None
    ]
    return max(values, default=1.0) or 1.0
