"""What only the whole survey can decide: its columns, their types, how deep its colours are."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from terraport_pipeline.engines.readers.attribute_names import distinct_names
from terraport_pipeline.engines.readers.survey_colours import Depth, choose_depth
from terraport_pipeline.engines.readers.survey_column import SurveyColumn
from terraport_pipeline.errors import SurveyError
from terraport_pipeline.stages.reading.spool import COLOUR, Spooled
from terraport_pipeline.survey.one_survey import listed
from terraport_pipeline.survey.survey_files import SurveyFiles

__all__ = ["Layout", "decide_layout"]

_MAX_EIGHT_BIT: Final = 255


@dataclass(frozen=True, slots=True)
class Layout:
    """What the whole survey's rows hold, decided when all files were read."""

    names: list[str]
    """Attributes in their order."""
    sources: list[str]
    """Column of the files that each comes from: its name, unless two were the same in a scene."""
    dtypes: list[np.dtype[Any]]
    fills: list[float]
    """Value of each where a file does not have it."""
    whole: list[str]
    """Attributes of whole numbers that are floats because some points have no value."""
    has_colour: bool
    depths: list[Depth | None]
    """For every file how its colours become 0..255; None where it has none."""

    @property
    def row(self) -> np.dtype[Any]:
        """Type of a row in a bucket."""
        fields: list[Any] = [("key", "<u8"), ("file", "<u2"), ("position", "<f8", (3,))]
        if self.has_colour:
            fields.append(("colour", "u1", (3,)))
        return np.dtype([*fields, *((f"a{i}", dtype) for i, dtype in enumerate(self.dtypes))])


def decide_layout(spooled: Sequence[Spooled], survey: SurveyFiles) -> tuple[Layout, list[str]]:
    """Decide what only the whole survey can: columns, their types, depth of the colours."""
    depths, warnings = _colour_depths(spooled)
    # (1) The union of all files' columns, each by what all its files hold.
    joined: dict[str, SurveyColumn] = {}
    lacking: dict[str, list[str]] = {}
    for part in spooled:
        for name, column in part.columns.items():
            if name == COLOUR:
                continue
            if name in joined:
                joined[name].join(column)
            else:
                joined[name] = copy.copy(column)
    for name in joined:
        without = [part.file.name for part in spooled if name not in part.columns]
        if without:
            lacking[name] = without
    # (2) Types, and what stands where a file lacks the column: the format's own "not set" where it
    # has one, else NaN. Whole numbers become float64 for that, which the clean stage knows of.
    names, dtypes, fills = [], [], []
    whole: list[str] = []
    gaps: dict[str, list[str]] = {}
    for name, column in joined.items():
        if column.says_nothing:
            continue
        dtype, fill = column.narrowed, 0.0
        if dtype.kind == "f" and any(name in part.stream.whole for part in spooled):
            whole.append(name)
        if name in lacking:
            if column.unset:
                fill = float(column.unset[0])
            else:
                if dtype.kind != "f":
                    whole.append(name)
                dtype, fill = _with_gaps(name, dtype, survey), np.nan
                gaps[name] = lacking[name]
        names.append(name)
        dtypes.append(dtype)
        fills.append(fill)
    renamed, notes = distinct_names(names)
    warnings += notes
    for name, without in gaps.items():
        warnings.append(
            f"Attribute {renamed[name]!r} is not in {listed(without)}: it has no value there."
        )
    has_colour = any(depth is not None for depth in depths)
    return Layout(
        [renamed[name] for name in names],
        names,
        dtypes,
        fills,
        [renamed[name] for name in whole],
        has_colour,
        depths,
    ), warnings


def _with_gaps(name: str, dtype: np.dtype[Any], survey: SurveyFiles) -> np.dtype[Any]:
    """Type that holds a column's values and NaN; whole numbers of 64 bits have none."""
    if dtype.kind == "f":
        return dtype
    if dtype.itemsize < np.dtype(np.int64).itemsize:
        return np.dtype(np.float64)
    raise SurveyError(
        f"{survey.title}: attribute {name!r} holds whole numbers of 64 bits in some files and is "
        "missing in others, and no value stands for missing; remove it, or build the files apart"
    )


def _colour_depths(spooled: Sequence[Spooled]) -> tuple[list[Depth | None], list[str]]:
    """Decide for every file how its colours become 0..255.

    Files of one format and type go together, as if they were one file; but one that holds nothing
    above 255 beside others that use 16 bits was written with 8 (a photo is never that dark).
    """
    groups: dict[tuple[str, str], list[Spooled]] = {}
    for part in spooled:
        if COLOUR in part.columns:
            groups.setdefault((part.stream.format, part.columns[COLOUR].dtype.str), []).append(part)
    rules: dict[int, Depth | None] = {}
    warnings: list[str] = []
    for (form, _), parts in groups.items():
        columns = [part.columns[COLOUR] for part in parts]
        low, high = min(c.low for c in columns), max(c.high for c in columns)
        where = ", ".join(parts[0].stream.colours)
        rule, notes = choose_depth(low, high, columns[0].dtype, where=where)
        warnings += notes
        few = "The colours use only 8 of the 16 bits that LAS gives them"
        if form == "las" and rule == "eight":
            warnings.append(f"{few}; they are taken as 0..255.")
        dark: list[str] = []
        for part, column in zip(parts, columns, strict=True):
            rules[id(part)] = rule
            if rule == "sixteen" and 0 < column.high <= _MAX_EIGHT_BIT:
                rules[id(part)] = "eight"
                dark.append(part.file.name)
        if dark:
            warnings.append(f"{few} in {listed(dark)}; there they are taken as 0..255.")
    without = [part.file.name for part in spooled if rules.get(id(part)) is None]
    if without and len(without) < len(spooled):
        warnings.append(f"There is no colour (RGB) in {listed(without)}: its points are grey.")
    return [rules.get(id(part)) for part in spooled], warnings
