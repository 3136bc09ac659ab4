"""What a page of tables and figures is made of: plain values, kept as JSON.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

from terraport_pipeline.errors import SurveyError

__all__ = ["FORM", "Column", "Figure", "Page", "Picture", "Row", "Stamp", "Table", "page_from_json"]

FORM: Final = 1
"""Of the JSON; another one is refused."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """What every number of a page carries."""

    terraport: str
    """Version."""
    commit: str
    """With a + where the checkout was changed."""
    mode: str
    """How it was asked: k told by model, which Th, which survey."""
    seed: int
    machine: str
    cpu_s: float
    """Processor time of making the page."""

    @property
    def line(self) -> str:
        """Said under every table and figure."""
        return (
            f"terraport {self.terraport}, commit {self.commit}, mode {self.mode}, seed {self.seed}"
        )


@dataclass(frozen=True, slots=True)
class Column:
    """One column of numbers."""

    key: str
    title: str
    digits: int = 3
    """After the point; 0 shows thousands apart."""
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a table: here and, where it printed one, in the thesis."""

    title: str
    values: tuple[float | None, ...]
    thesis: tuple[float | None, ...] = ()
    """As long as `values`, or empty."""
    note: str = ""
    """Why there is no value, or what differs."""

    def __post_init__(self) -> None:
        # NaN is none from here on: nothing that is made of a row need know of it.
        object.__setattr__(self, "values", tuple(_finite(value) for value in self.values))


@dataclass(frozen=True, slots=True)
class Table:
    """A printed table, with ours and the thesis's values."""

    key: str
    title: str
    head: str
    """Over the rows' names."""
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    bars: Literal["", "columns", "rows"] = ""
    """Drawn as bars too: a block for every column, or for every row."""
    only_bars: bool = False
    """Its numbers stand in another table of the page."""

    def cell(self, row: Row, column: int) -> str:
        """Write one value, the thesis's in brackets."""
        digits = self.columns[column].digits
        text = _number(row.values[column], digits)
        thesis = row.thesis[column] if row.thesis else None
        return text if thesis is None else f"{text} ({_number(thesis, digits)})"


@dataclass(frozen=True, slots=True)
class Picture:
    """One picture of a figure."""

    name: str
    """File in the folder ``pictures``."""
    title: str
    words: str = ""
    """Numbers that belong to it."""


@dataclass(frozen=True, slots=True)
class Figure:
    """A printed figure: pictures side by side."""

    key: str
    title: str
    pictures: tuple[Picture, ...]


@dataclass(frozen=True, slots=True)
class Page:
    """One page: tables and figures made by one piece of work, with one stamp."""

    key: str
    title: str
    text: tuple[str, ...]
    """Paragraphs: what was done, and what differs from the thesis."""
    tables: tuple[Table, ...]
    figures: tuple[Figure, ...]
    stamp: Stamp

    def to_json(self) -> dict[str, Any]:
        """Return plain values."""
        return {"form": FORM, **asdict(self)}


def page_from_json(document: Mapping[str, Any]) -> Page:
    """Read what :meth:`Page.to_json` gave.

    Raises
    ------
    SurveyError
        Of another form, or damaged.
    """
    try:
        if document["form"] != FORM:
            raise SurveyError(
                f"a page of form {document['form']!r}, expected {FORM}: make it again"
            )
        tables = tuple(
            Table(
                **{
                    **table,
                    "columns": tuple(Column(**column) for column in table["columns"]),
                    "rows": tuple(
                        Row(row["title"], tuple(row["values"]), tuple(row["thesis"]), row["note"])
                        for row in table["rows"]
                    ),
                }
            )
            for table in document["tables"]
        )
        figures = tuple(
            Figure(
                figure["key"],
                figure["title"],
                tuple(Picture(**picture) for picture in figure["pictures"]),
            )
            for figure in document["figures"]
        )
        return Page(
            document["key"],
            document["title"],
            tuple(document["text"]),
            tables,
            figures,
            Stamp(**document["stamp"]),
        )
    except (KeyError, TypeError) as error:
        raise SurveyError(f"a damaged page ({error}): make it again") from error


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _number(value: float | None, digits: int) -> str:
    if value is None:
        return "-"
    return f"{value:,.{digits}f}"
