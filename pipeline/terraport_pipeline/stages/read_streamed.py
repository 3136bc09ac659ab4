"""Read a survey of any number of files to columns on disk in bounded memory.

The result depends only on the points: not on their distribution over files, their order, or
duplicates in several files (tiles with a margin). Points outside the requested extent are skipped
before any statistics, in every format. Points without finite coordinates, with a height that means
"no data", or that a file marks as noise, are dropped and counted. Feet are converted to metres,
fields without information are dropped, duplicate records are kept once, and all points are sorted
along a curve through the survey's bounding box.

Three passes, each over blocks: files to raw rows on disk, rows to buckets that are consecutive
along the curve, buckets to sorted columns. Memory: one part of a file or one bucket (about 200 MB),
24 bytes for every 2,000th point, and statistics of each file. Disk: twice the size of the points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_pipeline.crs_axes import parts_of
from terraport_pipeline.engines.readers.height_edges import MAX_HEIGHT
from terraport_pipeline.engines.readers.point_order import HashThinning
from terraport_pipeline.engines.readers.survey_chunk import tell_precision
from terraport_pipeline.engines.readers.survey_colours import brightness_warnings
from terraport_pipeline.engines.readers.survey_crs import conversion_line, interpret_coordinates
from terraport_pipeline.engines.readers.text_units import check_units
from terraport_pipeline.errors import OptionError, ReadError
from terraport_pipeline.model import Crs
from terraport_pipeline.stages.contract import Context, Facts, Json
from terraport_pipeline.stages.reading.layout import decide_layout
from terraport_pipeline.stages.reading.sort import SurveyColumns, distribute, finish
from terraport_pipeline.stages.reading.spool import Outcome, Spooled, spool_all
from terraport_pipeline.stages.reading.strays import (
    PointFilter,
    check_box,
    leave_strays,
    leave_void_heights,
)
from terraport_pipeline.survey.one_survey import FAR, listed, one_crs
from terraport_pipeline.survey.survey_files import SurveyFiles
from terraport_store import SurveyUnits

__all__ = ["NAME", "run"]

NAME: Final = "read"

_THINNED_FROM: Final = 4
"""Points that are sorted for each that is kept: chosen by hash they lie at random, and one of four
neighbours along the curve is spread twice as evenly."""


def run(
    survey: SurveyFiles | Path,
    folder: Path,
    context: Context,
    *,
    max_points: int | None = None,
    bounded: bool = True,
    share: float = 1.0,
) -> tuple[Mapping[str, Json], Facts]:
    """Read a survey into a folder.

    Parameters
    ----------
    survey : SurveyFiles or pathlib.Path
    folder : pathlib.Path
        Receives ``points.npy``, ``colours.npy`` and ``attribute-<i>.npy``.
    context : Context
    max_points : int, optional
        Thin to this many points, evenly over the ground and deterministically. At least 1.
    bounded : bool
        Refuse files that can only be read whole.
    share : float
        Read about this share of each file, as :func:`open_stream` does: for a preview of the
        survey, not for a build.

    Returns
    -------
    values, facts
        ``attributes`` (names), ``crs``, ``format``, ``whole``, the box in ``low`` and ``high``, and
        ``units`` (:class:`SurveyUnits`) if they are not metres east, north and up.
        Values that depend on the files are in the facts' notes: ``files`` (xxh3, points, number of
        points outside the extent, duplicates), ``colours`` (their depths), ``outside`` (name and
        points of files without a point within the extent), ``empty`` (names), ``damaged`` (name and
        reason) and ``remarks`` (on indices that could not be used).

    Raises
    ------
    ReadError
        A file is damaged, without x, y, z, without one finite point or in degrees, or cannot be
        read in parts.
    SurveyError
        The files are no one survey, or have no point within its extent.
    OptionError
        `max_points` is not positive.
    """
    if max_points is not None and max_points < 1:
        raise OptionError(f"max_points is {max_points}, expected at least 1; leave it out for all")
    survey = SurveyFiles.of(survey)
    thinning = None if max_points is None else HashThinning(_THINNED_FROM * max_points)
    try:
        outcome = spool_all(survey, folder, context, thinning, bounded, share)
        spooled = outcome.spooled
        stated = [(part.file.name, part.stream.crs) for part in outcome.opened]
        crs = one_crs(stated, statement=survey.statement)
        crs = survey.crs_outside if crs is None else crs
        layout, decided = decide_layout(spooled, survey)
        taken, left = leave_void_heights(spooled)
        taken = leave_strays(spooled, taken)
        low = np.min([part.low for part in spooled], axis=0)
        high = np.max([part.high for part in spooled], axis=0)
        check_box(spooled, low, high)
        if crs is None and survey.statement.crs is None and survey.statement.units is None:
            # Before the coordinates are checked: an error about stated units is clearer.
            _check_units(spooled, None, survey)
        doubts = [doubt for part in outcome.opened for doubt in part.stream.doubts]
        units, metre_crs, notes = interpret_coordinates(
            survey.files[0].path, low, high, crs, survey.statement, doubts
        )
        _check_units(spooled, units, survey)
        warnings = [
            *_reader_warnings(spooled),
            *decided,
            *_point_warnings(outcome, taken),
            *left,
            *notes,
            *_file_warnings(spooled, crs, [*survey.damaged, *outcome.damaged]),
        ]
        choices = () if units is None else (conversion_line(units, crs, survey.statement),)
        if not layout.has_colour:
            warnings.append("The survey has no colour (RGB): what no photo shows will be grey.")
        buckets = distribute(spooled, layout, low, high, folder, context, thinning, taken)
        columns = SurveyColumns(folder, layout, units)
        finish(buckets, spooled, columns, folder, context, max_points)
        names = [part.file.name for part in spooled]
        warnings += brightness_warnings(columns.brightness, names, layout.rules)
    except OSError as error:
        if error.errno is not None and error.filename is None:
            raise  # our own writing: a full disk, named by the caller
        path = survey.files[0].path if error.filename is None else Path(str(error.filename))
        raise ReadError(path, f"the file cannot be read ({error})", "check the disk") from error
    return _result(columns, outcome, metre_crs, warnings, choices)


def _check_units(
    spooled: Sequence[Spooled], units: SurveyUnits | None, survey: SurveyFiles
) -> None:
    factors = None
    if units is not None:
        factors = np.array([units.horizontal_m, units.horizontal_m, units.height_m])
    for part in spooled:
        check_units(part.file.path, part.stream.units, factors, survey.statement)


def _reader_warnings(spooled: Sequence[Spooled]) -> list[str]:
    """Tell what the readers noticed: once where all files have it, else with their names."""
    by_text: dict[str, list[str]] = {}
    for part in spooled:
        for text in part.warnings:
            by_text.setdefault(text, []).append(part.file.name)
    return [
        text if len(names) == len(spooled) else f"{text} (In {listed(names)}.)"
        for text, names in by_text.items()
    ]


def _point_warnings(outcome: Outcome, taken: PointFilter) -> list[str]:
    """Tell of points that were dropped, and of coordinates that are too coarse."""
    warnings: list[str] = []
    read = sum(part.read for part in outcome.opened)
    dropped = sum(part.dropped for part in outcome.opened)
    if dropped:
        warnings.append(f"{dropped:,} of {read:,} points have no finite coordinates: dropped.")
    voids = sum(part.voids for part in outcome.spooled) - sum(
        part.heights.count(taken.voids) for part in outcome.spooled
    )
    if voids:
        warnings.append(
            f"{voids:,} of {read:,} points have a height beyond {MAX_HEIGHT:.0e}, which stands for "
            "no data: they are left out."
        )
    noise = sum(part.noise for part in outcome.spooled)
    if noise:
        warnings.append(
            f"{noise:,} of {read:,} points are marked in the survey as withheld or as noise "
            "(classes 7 and 18): left out. --keep-noise takes them."
        )
    strays = sum(part.strays for part in outcome.spooled)
    if strays:
        warnings.append(
            f"{strays:,} of {read:,} points lie more than {FAR / 1000:.0f} km from the others: "
            "dropped."
        )
    coarse = [part for part in outcome.spooled if not part.stream.stated_step]
    if coarse:
        single = np.all([part.single for part in coarse], axis=0)
        top = np.max([np.abs([part.low, part.high]).max(axis=0) for part in coarse], axis=0)
        warnings += tell_precision(single, top)
    return warnings


def _file_warnings(
    spooled: Sequence[Spooled], crs: Any | None, damaged: Sequence[tuple[str, str]]
) -> list[str]:
    """Tell of files that differ from the others, and of those that are left out."""
    warnings: list[str] = []
    without = [part.file.name for part in spooled if part.stream.crs is None]
    vertical = None if crs is None else parts_of(crs)[1]
    lacking = [
        part.file.name
        for part in spooled
        if part.stream.crs is not None and parts_of(part.stream.crs)[1] is None
    ]
    if vertical is not None and lacking:
        warnings.append(
            f"No vertical system is stated in {listed(lacking)}: heights are taken to be in that "
            f"of the others ({vertical.name})."
        )
    if crs is not None and without:
        warnings.append(
            f"No coordinate reference system is stated in {listed(without)}: taken to be in "
            f"that of the others ({crs.name})."
        )
    if damaged:
        each = "; ".join(f"{name} ({reason})" for name, reason in damaged)
        share = len(damaged) / (len(damaged) + len(spooled))
        warnings.append(f"Left out, {share:.1%} of the files, as they cannot be used: {each}.")
    return warnings


def _result(
    columns: SurveyColumns,
    outcome: Outcome,
    crs: Crs | None,
    warnings: Sequence[str],
    choices: Sequence[str],
) -> tuple[Mapping[str, Json], Facts]:
    layout = columns.layout
    formats = sorted({part.stream.format for part in outcome.spooled})
    values = {
        "attributes": layout.names,
        "crs": {"name": crs.name, "wkt": crs.wkt, "epsg": crs.epsg} if crs else None,
        "format": ", ".join(formats),
        **({"whole": layout.whole} if layout.whole else {}),
        **({} if columns.units is None else {"units": columns.units.document()}),
    }
    counts = {
        "points": columns.rows,
        "has_colour": layout.has_colour,
        "attributes": len(layout.names),
        "format": values["format"],
        "crs": crs.name if crs else None,
        "low": columns.low.tolist(),
        "high": columns.high.tolist(),
    }
    notes = {
        "files": [
            {
                "xxh3": part.file.xxh3,
                "points": part.read + part.stream.skipped,
                "outside": (
                    part.read
                    + part.stream.skipped
                    - part.kept
                    - part.dropped
                    - part.noise
                    - part.voids
                    - part.strays
                ),
                "repeats": part.repeats,
            }
            for part in outcome.spooled
        ],
        "outside": [[part.file.name, part.read + part.stream.skipped] for part in outcome.outside],
        "colours": sorted({name for rule in layout.rules for name in rule.names}),
        "empty": [name for name, _ in outcome.empty],
        "damaged": [[name, reason] for name, reason in outcome.damaged],
        "remarks": [text for part in outcome.opened for text in part.stream.remarks],
    }
    return values, Facts(counts, tuple(warnings), notes, tuple(choices))
