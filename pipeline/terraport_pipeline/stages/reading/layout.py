"""What only the whole survey can decide: its columns, their types, how deep its colours are."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from terraport_payload.segment_format import MAX_ATTRIBUTES
from terraport_pipeline.engines.readers.attribute_names import distinct_names
from terraport_pipeline.engines.readers.survey_colours import ColourRule, choose_rule
from terraport_pipeline.engines.readers.survey_column import SurveyColumn
from terraport_pipeline.errors import SurveyError
from terraport_pipeline.stages.reading.spool import COLOUR, Spooled
from terraport_pipeline.survey.one_survey import listed
from terraport_pipeline.survey.survey_files import SurveyFiles

__all__ = ["Layout", "decide_layout"]

_EIGHT: Final = 255.0
_SIXTEEN: Final = 65535.0

_MOST_ATTRIBUTES: Final = MAX_ATTRIBUTES - 1
"""Attributes that are read; one more is the build's own, the change of height."""

_DARK: Final = 0.05
"""Share of points with values up to 255 in 16-bit files above which the whole survey is dark."""


@dataclass(frozen=True, slots=True)
class Layout:
    """What the whole survey's rows hold, decided when all files were read."""

    names: list[str]
    """Attributes in their order."""
    sources: list[str]
    """Column of the files for each attribute; differs from its name if the attribute was
    renamed."""
    dtypes: list[np.dtype[Any]]
    fills: list[float]
    """Value of each where a file does not have it."""
    whole: list[str]
    """Attributes of whole numbers that are stored as floats because some points have no value."""
    colours: list[dict[int, ColourRule]]
    """Colour rules of every file, by scan; empty for a file without colours."""

    @property
    def has_colour(self) -> bool:
        """True if any point has a colour."""
        return any(self.colours)

    @property
    def rules(self) -> list[ColourRule]:
        """All distinct rules."""
        every = {rule for rules in self.colours for rule in rules.values()}
        return sorted(every, key=lambda rule: (rule.tops, rule.low))

    @property
    def row(self) -> np.dtype[Any]:
        """Type of a row in a bucket."""
        fields: list[Any] = [("key", "<u8"), ("file", "<u2"), ("position", "<f8", (3,))]
        if self.has_colour:
            fields.append(("colour", "u1", (3,)))
        return np.dtype([*fields, *((f"a{i}", dtype) for i, dtype in enumerate(self.dtypes))])


def decide_layout(spooled: Sequence[Spooled], survey: SurveyFiles) -> tuple[Layout, list[str]]:
    """Decide what only the whole survey can: columns, their types, depth of the colours."""
    colours, warnings = _colour_rules(spooled)
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
    names: list[str] = []
    dtypes, fills = [], []
    whole: list[str] = []
    left_out: list[str] = []
    gaps: dict[str, list[str]] = {}
    for name, column in joined.items():
        if column.says_nothing:
            continue
        if len(names) == _MOST_ATTRIBUTES:
            left_out.append(name)
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
    if left_out:
        warnings.append(
            f"The survey has {len(names) + len(left_out)} attributes, expected at most "
            f"{_MOST_ATTRIBUTES}: {listed(left_out)} are left out."
        )
    renamed, notes = distinct_names(names)
    warnings += notes
    for name in names:
        if extremes := joined[name].extremes:
            warnings.append(
                f"Attribute {renamed[name]!r} has {extremes:,} values beyond 1e30, which stand for "
                "no data: it has no value there."
            )
        if (code := joined[name].void_code) is not None:
            warnings.append(
                f"Attribute {renamed[name]!r} is {code:,g} in {joined[name].voids:,} points, which "
                "often stands for no data: it is taken as a value, in means too. If it is none, "
                "leave it empty in the file, or state it (LAS: no_data of an extra dimension)."
            )
    for name, without in gaps.items():
        warnings.append(
            f"Attribute {renamed[name]!r} is not in {listed(without)}: it has no value there."
        )
    return Layout(
        [renamed[name] for name in names],
        names,
        dtypes,
        fills,
        [renamed[name] for name in whole],
        colours,
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


def _colour_rules(spooled: Sequence[Spooled]) -> tuple[list[dict[int, ColourRule]], list[str]]:
    """Choose the colour rule of every file and of every scan in it."""
    # (1) Each by its own values.
    rules: list[dict[int, ColourRule]] = []
    said: dict[str, list[str]] = {}
    for part in spooled:
        chosen: dict[int, ColourRule] = {}
        for scan, counts in part.colours.items():
            rule, notes = choose_rule(
                counts, part.columns[COLOUR].dtype, where=", ".join(part.stream.colours)
            )
            if rule is not None:
                chosen[scan] = rule
            for note in notes:
                of = f" of {part.file.name}" if len(spooled) > 1 else ""
                name = part.file.name if len(part.colours) == 1 else f"scan {scan}{of}"
                said.setdefault(note, []).append(name)
        rules.append(chosen)
    _keep_dark(spooled, rules)
    # (2) Warnings.
    one = len(spooled) == 1 and len(spooled[0].colours) <= 1
    warnings = [note if one else f"{note} (In {listed(names)}.)" for note, names in said.items()]
    narrow = [
        part.file.name
        for part, chosen in zip(spooled, rules, strict=True)
        if part.stream.format == "las" and ColourRule((_EIGHT,)) in chosen.values()
    ]
    if narrow:
        where = f" in {listed(narrow)}; there" if len(narrow) < len(spooled) else ";"
        warnings.append(
            f"The colours use only 8 of the 16 bits that LAS gives them{where} they are taken as "
            "0..255."
        )
    without = [part.file.name for part, chosen in zip(spooled, rules, strict=True) if not chosen]
    if without and len(without) < len(spooled):
        warnings.append(f"There is no colour (RGB) in {listed(without)}: its points are grey.")
    grey = sum(
        counts.none + counts.impossible if scan in chosen else counts.none + counts.total
        for part, chosen in zip(spooled, rules, strict=True)
        if chosen
        for scan, counts in part.colours.items()
    )
    if grey:
        points = sum(part.kept for part in spooled)
        warnings.append(
            f"{grey:,} of {points:,} points have no colour, or one that is marked as invalid: they "
            "are grey."
        )
    return rules, warnings


def _keep_dark(spooled: Sequence[Spooled], rules: list[dict[int, ColourRule]]) -> None:
    """Also read files without a value above 255 as 16 bits if the whole survey is dark.

    On its own, or among bright files, such a file has 8 bits: a photo is never that dark. If many
    points of the other files are also dark, it has 16 bits like them.
    """
    eight, sixteen = ColourRule((_EIGHT,)), ColourRule((_SIXTEEN,))
    groups: dict[tuple[str, str], list[int]] = {}
    for number, part in enumerate(spooled):
        if part.stream.scan_column is None and COLOUR in part.columns:
            key = (part.stream.format, part.columns[COLOUR].dtype.str)
            groups.setdefault(key, []).append(number)
    for numbers in groups.values():
        wide = [spooled[n].colours[0] for n in numbers if rules[n].get(0) == sixteen]
        below = sum(counts.below(_EIGHT) for counts in wide)
        if below > _DARK * max(1, sum(counts.total for counts in wide)):
            for n in numbers:
                if rules[n].get(0) == eight:
                    rules[n] = {0: sixteen}
