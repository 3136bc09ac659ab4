"""Read a survey, whatever files it comes in, to columns on disk in bounded memory.

The result depends on the points alone: not on how they lie in files, in which order, or whether
some lie in several (tiles with a margin). Points outside the extent that was asked for are left
out before anything is noted of them, however their file is read; those without finite coordinates
are dropped and counted, feet become metres, fields that say nothing are left out, records that
repeat another in every value are taken once, and all are put along a curve through the survey's
box.

Three passes, each over blocks: files to raw rows on disk, these to buckets that are consecutive
along the curve, buckets to sorted columns. Memory: one part of a file or one bucket (about 200 MB),
24 bytes for every 2,000th point, and what is noted of each file. Disk: the points twice.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, Bool, Float64, Int64
from terraport_pipeline.engines.readers.npy_columns import NpyReader, NpyWriter
from terraport_pipeline.engines.readers.point_order import (
    HashThinning,
    curve_keys,
    order_rows,
    point_hashes,
)
from terraport_pipeline.engines.readers.raw_survey import (
    Depth,
    StreamChunk,
    apply_depth,
    choose_depth,
    tell_precision,
    thinning_rows,
)
from terraport_pipeline.engines.readers.survey_column import SurveyColumn
from terraport_pipeline.engines.readers.survey_crs import metre_factors
from terraport_pipeline.engines.readers.survey_stream import SurveyStream, open_stream
from terraport_pipeline.errors import NoPointsError, OptionError, ReadError, SurveyError
from terraport_pipeline.model import Crs
from terraport_pipeline.stages.contract import Context, Facts, Json
from terraport_pipeline.survey_files import (
    FAR,
    SurveyFile,
    SurveyFiles,
    damage_of,
    listed,
    nothing_within,
    one_crs,
    refuse_far,
)

__all__ = ["MAX_SPAN_M", "NAME", "run"]

NAME: Final = "read"

MAX_SPAN_M: Final = 1e7
"""No survey is wider than a quarter of the Earth: larger spans are damaged coordinates."""

_BLOCK_ROWS: Final = 500_000
"""Rows in memory at once while they are handed out to buckets."""

_BUCKET_ROWS: Final = 1_000_000
"""Rows of a bucket, about; a bucket is sorted in memory."""

_SAMPLE_STEP: Final = 2000
"""One point in so many says where buckets begin: 500 samples a bucket make them equal to 5 %."""

_THINNED_FROM: Final = 4
"""Points that are sorted for each that is kept: chosen by hash they lie at random, and one of four
neighbours along the curve is spread twice as evenly."""

_COLOUR: Final = "\0colour"
"""Name of the colour columns as one: no field can be called so."""

_GREY: Final = 160
"""sRGB of points whose file has no colour, in a survey that has; as the clean stage paints."""

_MAX_EIGHT_BIT: Final = 255

_MEDIAN_POINTS: Final = 1_000_000
"""Points that the survey's middle is the median of, about."""

_MOST_STRAYS: Final = 0.01
"""Share of points that may lie far from the others; more are another site, not a slip."""


@dataclass(slots=True)
class _Spooled:
    """One file as rows on disk, and what is known of it."""

    file: SurveyFile
    path: Path
    stream: SurveyStream
    fields: dict[str, str]
    """Name of every column's field in the rows."""
    columns: dict[str, SurveyColumn]
    writer: NpyWriter
    read: int = 0
    kept: int = 0
    dropped: int = 0
    """Points without finite coordinates."""
    low: Float64 = field(default_factory=lambda: np.full(3, np.inf))
    high: Float64 = field(default_factory=lambda: np.full(3, -np.inf))
    single: Bool = field(default_factory=lambda: np.ones(3, dtype=bool))
    warnings: tuple[str, ...] = ()
    samples: list[Float64] = field(default_factory=list)
    strays: int = 0
    """Points that lie so far from all others that they are left out."""
    repeats: int = 0
    """Its points that a file before it has, too, or that are in it twice."""

    def look(self, points: Float64) -> None:
        """Take further finite points into account."""
        self.kept += len(points)
        if len(points):
            self.low = np.minimum(self.low, points.min(axis=0))
            self.high = np.maximum(self.high, points.max(axis=0))
            self.single &= np.array([(p.astype(np.float32) == p).all() for p in points.T])


@dataclass(frozen=True, slots=True)
class _Outside:
    """A file without a point within the extent."""

    file: SurveyFile
    stream: SurveyStream
    read: int
    dropped: int
    box: tuple[Any, Any]
    """Corners of its points, or None twice."""


@dataclass(slots=True)
class _Outcome:
    """What came of all files."""

    spooled: list[_Spooled] = field(default_factory=list)
    outside: list[_Outside] = field(default_factory=list)
    empty: list[tuple[str, str]] = field(default_factory=list)
    """Name and reason of files without points."""
    damaged: list[tuple[str, str]] = field(default_factory=list)

    @property
    def opened(self) -> list[_Spooled | _Outside]:
        """All files that were read."""
        return [*self.spooled, *self.outside]


@dataclass(frozen=True, slots=True)
class _Layout:
    """What the whole survey's rows hold, decided when all files were read."""

    names: list[str]
    """Attributes in their order."""
    dtypes: list[np.dtype[Any]]
    fills: list[float]
    """Value of each where a file does not have it."""
    whole: list[str]
    """Attributes of whole numbers that are floats because some files do not have them."""
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
        Gets ``points.npy``, ``colours.npy`` and ``attribute-<i>.npy``.
    context : Context
    max_points : int, optional
        Thin to this many points, evenly over the ground, the same ones each time. At least 1.
    bounded : bool
        Refuse files that can only be read whole.
    share : float
        Read about this share of each file, as :func:`open_stream` does: for a look at the survey,
        not for a build.

    Returns
    -------
    values, facts
        ``attributes`` (names), ``crs``, ``format``, ``whole``, the box in ``low`` and ``high``, and
        ``units_m`` (metres in a unit of the eastings, and of the heights) where they are not 1.
        What depends on the files stands in the facts' notes: ``files`` (xxh3, points, those of
        them outside the extent, repeats), and of what reading found ``colours`` (how deep),
        ``outside`` (name and points of files without a point within the extent), ``empty`` (names),
        ``damaged`` (name and reason) and ``remarks`` (on indices that could not be used).

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
        outcome = _spool_all(survey, folder, context, thinning, bounded, share)
        spooled = outcome.spooled
        crs = one_crs([(part.file.name, part.stream.crs) for part in outcome.opened])
        crs = survey.crs_outside if crs is None else crs
        layout, decided = _decide(spooled, survey)
        near = _leave_strays(spooled)
        low = np.min([part.low for part in spooled], axis=0)
        high = np.max([part.high for part in spooled], axis=0)
        _check_box(spooled, low, high)
        factors, metre_crs, notes = metre_factors(
            survey.files[0].path, low, high, crs, survey.statement
        )
        warnings = [
            *_reader_warnings(spooled),
            *decided,
            *_point_warnings(outcome),
            *notes,
            *_file_warnings(spooled, crs, [*survey.damaged, *outcome.damaged]),
        ]
        if not layout.has_colour:
            warnings.append("The survey has no colour (RGB): what no photo shows will be grey.")
        buckets = _distribute(spooled, layout, low, high, folder, context, thinning, near)
        columns = _Columns(folder, layout, factors)
        _finish(buckets, spooled, columns, folder, context, max_points)
    except OSError as error:
        if error.errno is not None and error.filename is None:
            raise  # our own writing: a full disk, named by the caller
        path = survey.files[0].path if error.filename is None else Path(str(error.filename))
        raise ReadError(path, f"the file cannot be read ({error})", "check the disk") from error
    return _result(columns, outcome, metre_crs, warnings)


def _spool_all(
    survey: SurveyFiles,
    folder: Path,
    context: Context,
    thinning: HashThinning | None,
    bounded: bool,
    share: float,
) -> _Outcome:
    """Write every file down."""
    outcome = _Outcome()
    alone = len(survey.files) == 1
    reading = _Reading(survey, context)
    for number, file in enumerate(survey.files):
        path = folder / f"raw-{number}.npy"
        try:
            part = _spool(file, path, thinning, reading, survey, bounded=bounded, share=share)
        except NoPointsError:
            if alone:
                raise
            outcome.empty.append((file.name, "has no points"))
        except ReadError as error:
            if alone:
                raise
            if not survey.skip_damaged:
                raise damage_of([error], len(survey.files)) from error
            outcome.damaged.append((file.name, error.reason))
            path.unlink(missing_ok=True)
        else:
            if isinstance(part, _Outside):
                outcome.outside.append(part)
                path.unlink(missing_ok=True)
            else:
                outcome.spooled.append(part)
    points = sum(part.kept for part in outcome.spooled)
    files = {} if alone else {"files": len(outcome.spooled)}
    context.progress.done({"points": points, **files})
    if outcome.spooled:
        return outcome
    if survey.extent is not None and outcome.outside:
        crs = one_crs([(part.file.name, part.stream.crs) for part in outcome.outside])
        boxes = [part.box for part in outcome.outside]
        raise nothing_within(survey.title, survey.extent, boxes, crs)
    names = listed([name for name, _ in (*outcome.damaged, *outcome.empty)])
    raise SurveyError(f"{survey.title}: not one of its files can be used: {names}")


class _Reading:
    """Progress of reading: of one file in its own unit, of several in their bytes."""

    def __init__(self, survey: SurveyFiles, context: Context) -> None:
        self._progress, self._alone = context.progress, len(survey.files) == 1
        if not self._alone:
            title = f"read {len(survey.files)} files"
            self._progress.start(title, float(survey.size_bytes), "bytes")

    def start(self, file: SurveyFile, stream: SurveyStream) -> None:
        """Begin a file."""
        if self._alone:
            self._progress.start(f"read {file.name}", stream.total, stream.unit)

    def advance(self, file: SurveyFile, stream: SurveyStream, read: int) -> None:
        """Tell of a part of a file."""
        share = 1.0 if self._alone else file.bytes / max(stream.total, 1)
        self._progress.advance(read * share)


def _spool(
    file: SurveyFile,
    path: Path,
    thinning: HashThinning | None,
    reading: _Reading,
    survey: SurveyFiles,
    *,
    bounded: bool,
    share: float,
) -> _Spooled | _Outside:
    """Write a file's points within the extent down as it has them, those that are finite.

    Nothing is noted of points outside the extent: what is decided from the columns is the same
    whether an index leaves them out or not.
    """
    part: _Spooled | None = None
    extent = survey.extent
    box = np.full(3, np.inf), np.full(3, -np.inf)
    with open_stream(
        file.path,
        file.format,
        bounded=bounded,
        extent=extent,
        columns=survey.statement.columns,
        share=share,
    ) as stream:
        if stream.crs is None:
            stream = replace(stream, crs=file.crs_beside)
        reading.start(file, stream)
        for chunk in stream.chunks():
            # (1) Which points are taken. Invariant: read = kept + dropped + those outside.
            columns = _columns_of(chunk, stream)
            if part is None:
                part = _open_rows(file, path, stream, columns)
            part.read += len(chunk.points)
            taken = np.isfinite(chunk.points).all(axis=1)
            part.dropped += len(chunk.points) - int(taken.sum())
            if extent is not None:
                _widen(box, chunk.points[taken])
                taken &= extent.holds(chunk.points)
            # (2) What they are: position, columns.
            points = (chunk.points if taken.all() else chunk.points[taken]) + 0.0  # no -0.0
            part.look(points)
            rows: AnyArray = np.empty(len(points), part.writer.dtype)
            rows["position"] = points
            for name, values in columns.items():
                good = values if taken.all() else values[taken]
                part.columns[name].look(good)
                rows[part.fields[name]] = good
            # (3) Those that may stay where the survey is thinned.
            if thinning is not None:
                hashes = point_hashes(points)
                thinning.look(hashes)
                rows = rows[hashes <= np.uint64(thinning.limit)]
            part.samples.append(rows["position"][::_SAMPLE_STEP].copy())
            part.writer.append(rows)
            reading.advance(file, stream, chunk.read)
        late = stream.late_warnings()
    if part is not None:
        part.writer.close()
    if part is not None and part.kept:
        part.warnings = (*late, *stream.warnings)
        return part
    read, dropped = (0, 0) if part is None else (part.read, part.dropped)
    if extent is not None and (stream.skipped or read > dropped):
        corners = stream.box or (box if read > dropped else (None, None))
        return _Outside(file, _bare(stream), read, dropped, corners)
    raise ReadError(
        file.path,
        f"not one of {read:,} points has finite coordinates",
        "export the survey again",
    )


def _widen(box: tuple[Float64, Float64], points: Float64) -> None:
    """Widen a box so that it holds some points."""
    if len(points):
        np.minimum(box[0], points.min(axis=0), out=box[0])
        np.maximum(box[1], points.max(axis=0), out=box[1])


def _open_rows(
    file: SurveyFile, path: Path, stream: SurveyStream, columns: Mapping[str, AnyArray]
) -> _Spooled:
    fields = {name: f"f{number}" for number, name in enumerate(columns)}
    row: list[Any] = [("position", "<f8", (3,))]
    row += [(fields[name], values.dtype, values.shape[1:]) for name, values in columns.items()]
    known = {
        name: SurveyColumn(values.dtype, tuple(stream.unset.get(name, ())), stream.narrow)
        for name, values in columns.items()
    }
    return _Spooled(file, path, _bare(stream), fields, known, NpyWriter(path, np.dtype(row)))


def _bare(stream: SurveyStream) -> SurveyStream:
    """Part a stream from what it was made of, which must not outlive it: there are thousands."""
    return replace(stream, chunks=_no_chunks, late_warnings=tuple)


def _no_chunks() -> Iterator[StreamChunk]:
    return iter(())


def _columns_of(chunk: StreamChunk, stream: SurveyStream) -> dict[str, AnyArray]:
    """Take the colours together; give each component of a vector field its own name."""
    out: dict[str, AnyArray] = {}
    has_colour = bool(stream.colours) and all(name in chunk.columns for name in stream.colours)
    if has_colour:
        channels = [chunk.columns[name] for name in stream.colours]
        wide = channels[0] if len(channels) == 1 else np.stack(channels, axis=1)
        if wide.dtype.kind == "f":
            valid: Bool = np.all(np.isfinite(wide), axis=1)
            wide = np.where(valid[:, None], wide, wide.dtype.type(0))
        out[_COLOUR] = wide
    for name, values in chunk.columns.items():
        if has_colour and name in stream.colours:
            continue
        if values.ndim == 1:
            out[name] = values
        else:
            for component in range(values.shape[1]):
                out[f"{name}_{component}"] = values[:, component]
    return out


def _decide(spooled: Sequence[_Spooled], survey: SurveyFiles) -> tuple[_Layout, list[str]]:
    """Decide what only the whole survey can: columns, their types, depth of the colours."""
    depths, warnings = _colour_depths(spooled)
    # (1) The union of all files' columns, each by what all its files hold.
    joined: dict[str, SurveyColumn] = {}
    lacking: dict[str, list[str]] = {}
    for part in spooled:
        for name, column in part.columns.items():
            if name == _COLOUR:
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
    for name, without in gaps.items():
        warnings.append(f"Attribute {name!r} is not in {listed(without)}: it has no value there.")
    has_colour = any(depth is not None for depth in depths)
    return _Layout(names, dtypes, fills, whole, has_colour, depths), warnings


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


def _colour_depths(spooled: Sequence[_Spooled]) -> tuple[list[Depth | None], list[str]]:
    """Decide for every file how its colours become 0..255.

    Files of one format and type go together, as if they were one file; but one that holds nothing
    above 255 beside others that use 16 bits was written with 8 (a photo is never that dark).
    """
    groups: dict[tuple[str, str], list[_Spooled]] = {}
    for part in spooled:
        if _COLOUR in part.columns:
            groups.setdefault((part.stream.format, part.columns[_COLOUR].dtype.str), []).append(
                part
            )
    rules: dict[int, Depth | None] = {}
    warnings: list[str] = []
    for (form, _), parts in groups.items():
        columns = [part.columns[_COLOUR] for part in parts]
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


@dataclass(frozen=True, slots=True)
class _Near:
    """Where the survey is, when some points are so far away that they cannot be of it."""

    middle: Float64
    """(3,) median of all points."""

    def holds(self, points: Float64) -> Bool:
        """Tell which of some points (n, 3) are of the survey."""
        near: Bool = np.abs(points - self.middle).max(axis=1) <= FAR
        return near


def _leave_strays(spooled: Sequence[_Spooled]) -> _Near | None:
    """Leave out the few points that lie hundreds of kilometres from all others, such as 0 0 0.

    Returns
    -------
    _Near or None
        None where there is none, or where they are too many: then the survey is refused by
        :func:`_check_box`. What the columns noted of them (greatest values) stays noted.
    """
    low = np.min([part.low for part in spooled], axis=0)
    high = np.max([part.high for part in spooled], axis=0)
    if float((high - low).max()) <= 2 * FAR:
        return None
    # (1) The median of at most a million points.
    total = sum(part.writer.rows for part in spooled)
    step = max(1, total // _MEDIAN_POINTS)
    chosen = [
        rows["position"][::step]
        for part in spooled
        for _, rows in NpyReader(part.path).blocks(_BLOCK_ROWS)
    ]
    near = _Near(np.median(np.concatenate(chosen), axis=0))
    # (2) How many there are of each file, and the box of the others.
    strays, boxes = [], []
    for part in spooled:
        count, box = 0, (np.full(3, np.inf), np.full(3, -np.inf))
        for _, rows in NpyReader(part.path).blocks(_BLOCK_ROWS):
            inside = near.holds(rows["position"])
            count += len(rows) - int(inside.sum())
            _widen(box, rows["position"][inside])
        strays.append(count)
        boxes.append(box)
    some_left = all(n < part.writer.rows for n, part in zip(strays, spooled, strict=True))
    if sum(strays) > _MOST_STRAYS * total or not some_left:
        return None
    for part, count, (least, most) in zip(spooled, strays, boxes, strict=True):
        part.kept, part.strays, part.low, part.high = part.kept - count, count, least, most
        part.samples = [some[near.holds(some)] for some in part.samples]
    return near


def _check_box(spooled: Sequence[_Spooled], low: Float64, high: Float64) -> None:
    """Refuse damaged coordinates, and files that lie far from the others."""
    span = float((high - low).max())
    if span > MAX_SPAN_M:
        wide = max(spooled, key=lambda part: float(np.abs([part.low, part.high]).max()))
        raise ReadError(
            wide.file.path,
            f"the coordinates span {span:.3g}, expected less than {MAX_SPAN_M:.0e} metres",
            "some are damaged: remove them or export the survey again",
        )
    names = [part.file.name for part in spooled]
    refuse_far(names, [((part.low + part.high) / 2).tolist() for part in spooled])
    if span > 2 * FAR:
        raise SurveyError(
            f"the points lie up to {span / 1000:,.0f} km apart, more than {_MOST_STRAYS:.0%} of "
            "them far from the others; expected one site: cut one out with --extent, or remove "
            "the stray points"
        )


def _reader_warnings(spooled: Sequence[_Spooled]) -> list[str]:
    """Tell what the readers noticed: once where all files have it, else with their names."""
    by_text: dict[str, list[str]] = {}
    for part in spooled:
        for text in part.warnings:
            by_text.setdefault(text, []).append(part.file.name)
    return [
        text if len(names) == len(spooled) else f"{text} (In {listed(names)}.)"
        for text, names in by_text.items()
    ]


def _point_warnings(outcome: _Outcome) -> list[str]:
    """Tell of points that were dropped, and of coordinates that are too coarse."""
    warnings: list[str] = []
    read = sum(part.read for part in outcome.opened)
    dropped = sum(part.dropped for part in outcome.opened)
    if dropped:
        warnings.append(f"{dropped:,} of {read:,} points have no finite coordinates: dropped.")
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
    spooled: Sequence[_Spooled], crs: Any | None, damaged: Sequence[tuple[str, str]]
) -> list[str]:
    """Tell of files that differ from the others, and of those that are left out."""
    warnings: list[str] = []
    without = [part.file.name for part in spooled if part.stream.crs is None]
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


def _distribute(
    spooled: Sequence[_Spooled],
    layout: _Layout,
    low: Float64,
    high: Float64,
    folder: Path,
    context: Context,
    thinning: HashThinning | None,
    near: _Near | None,
) -> list[NpyWriter]:
    """Hand the rows out to buckets that follow one another along the curve."""
    # (1) Where buckets begin, from a sample. It decides their size, not what comes out.
    samples = np.concatenate([sample for part in spooled for sample in part.samples])
    keys = np.sort(curve_keys(samples, low, high))
    total = sum(part.writer.rows for part in spooled)
    count = max(1, -(-total // _BUCKET_ROWS))
    starts = keys[np.arange(1, count) * len(keys) // count] if len(keys) else keys
    buckets = [NpyWriter(folder / f"bucket-{i}.npy", layout.row) for i in range(len(starts) + 1)]
    # (2) Block by block. Invariant: every row of the files so far is in its bucket, and the raw
    # rows of files that are done are deleted.
    context.progress.start("read: order", float(2 * total), "points")
    for number, part in enumerate(spooled):
        for _, raw in NpyReader(part.path).blocks(_BLOCK_ROWS):
            context.progress.advance(len(raw))
            if near is not None:
                raw = raw[near.holds(raw["position"])]
            if thinning is not None:  # the limit has fallen since
                raw = raw[point_hashes(raw["position"]) <= np.uint64(thinning.limit)]
            rows = _converted(raw, number, part, layout)
            rows["key"] = curve_keys(rows["position"], low, high)
            if not len(starts):
                buckets[0].append(rows)
                continue
            bucket = np.searchsorted(starts, rows["key"], side="right")
            order = np.argsort(bucket, kind="stable")
            edges = np.searchsorted(bucket[order], np.arange(len(buckets) + 1))
            for i in np.flatnonzero(np.diff(edges)):
                buckets[i].append(rows[order[edges[i] : edges[i + 1]]])
        part.path.unlink()
    for writer in buckets:
        writer.close()
    return buckets


def _converted(raw: AnyArray, number: int, part: _Spooled, layout: _Layout) -> AnyArray:
    """Bring a file's rows to the survey's columns."""
    rows: AnyArray = np.empty(len(raw), layout.row)
    rows["file"] = number
    rows["position"] = raw["position"]
    if layout.has_colour:
        depth = layout.depths[number]
        if depth is None:
            rows["colour"] = _GREY
        else:
            rows["colour"] = apply_depth(raw[part.fields[_COLOUR]], depth)
    for i, name in enumerate(layout.names):
        rows[f"a{i}"] = raw[part.fields[name]] if name in part.fields else layout.fills[i]
    return rows


class _Columns:
    """The survey's columns, written row by row in metres."""

    def __init__(self, folder: Path, layout: _Layout, factors: Float64 | None) -> None:
        self.layout, self.factors = layout, factors
        self._points = NpyWriter(folder / "points.npy", np.float64, (3,))
        self._colours = (
            NpyWriter(folder / "colours.npy", np.uint8, (3,)) if layout.has_colour else None
        )
        self._attributes = [
            NpyWriter(folder / f"attribute-{i}.npy", dtype) for i, dtype in enumerate(layout.dtypes)
        ]
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)

    @property
    def rows(self) -> int:
        """Points written."""
        return self._points.rows

    def append(self, rows: AnyArray) -> None:
        """Write further rows."""
        if not len(rows):
            return
        points = np.ascontiguousarray(rows["position"])
        if self.factors is not None:
            points = points * self.factors
        self.low = np.minimum(self.low, points.min(axis=0))
        self.high = np.maximum(self.high, points.max(axis=0))
        self._points.append(points)
        if self._colours is not None:
            self._colours.append(rows["colour"])
        for i, writer in enumerate(self._attributes):
            writer.append(rows[f"a{i}"])

    def close(self) -> None:
        """Finish all files."""
        for writer in (self._points, self._colours, *self._attributes):
            if writer is not None:
                writer.close()


def _finish(
    buckets: Sequence[NpyWriter],
    spooled: Sequence[_Spooled],
    columns: _Columns,
    folder: Path,
    context: Context,
    max_points: int | None,
) -> None:
    """Sort every bucket, take repeats once, thin, and write the columns."""
    if max_points is None or sum(bucket.rows for bucket in buckets) <= max_points:
        for rows in _sorted(buckets, spooled, columns.layout, context):
            columns.append(rows)
    else:
        # How many there are without repeats is known only after all are sorted.
        whole = NpyWriter(folder / "sorted.npy", columns.layout.row)
        for rows in _sorted(buckets, spooled, columns.layout, context):
            whole.append(rows)
        whole.close()
        chosen = thinning_rows(whole.rows, max_points)
        for first, block in NpyReader(whole.path).blocks(_BLOCK_ROWS):
            if chosen is not None:
                begin, end = np.searchsorted(chosen, (first, first + len(block)))
                block = block[chosen[begin:end] - first]
            columns.append(block)
        whole.path.unlink()
    columns.close()
    context.progress.done({"points": columns.rows})


def _sorted(
    buckets: Sequence[NpyWriter],
    spooled: Sequence[_Spooled],
    layout: _Layout,
    context: Context,
) -> Iterator[AnyArray]:
    """Yield the rows of all buckets in order, each once; count repeats by file."""
    repeats: Int64 = np.zeros(len(spooled), np.int64)
    for bucket in buckets:
        rows = NpyReader(bucket.path).read(0, bucket.rows)
        bucket.path.unlink()
        values = [*rows["position"].T]
        if layout.has_colour:
            values += [*rows["colour"].T]
        values += [rows[f"a{i}"] for i in range(len(layout.names))]
        order, again = order_rows(rows["key"], values, rows["file"])
        repeats += np.bincount(rows["file"][order[again]], minlength=len(spooled))
        context.progress.advance(len(rows))
        yield rows[order[~again]]
    for part, count in zip(spooled, repeats, strict=True):
        part.repeats = int(count)


def _result(
    columns: _Columns, outcome: _Outcome, crs: Crs | None, warnings: list[str]
) -> tuple[Mapping[str, Json], Facts]:
    layout = columns.layout
    formats = sorted({part.stream.format for part in outcome.spooled})
    values = {
        "attributes": layout.names,
        "crs": {"name": crs.name, "wkt": crs.wkt, "epsg": crs.epsg} if crs else None,
        "format": ", ".join(formats),
        **({"whole": layout.whole} if layout.whole else {}),
        **({} if columns.factors is None else {"units_m": columns.factors[[0, 2]].tolist()}),
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
                    part.read + part.stream.skipped - part.kept - part.dropped - part.strays
                ),
                "repeats": part.repeats,
            }
            for part in outcome.spooled
        ],
        "outside": [[part.file.name, part.read + part.stream.skipped] for part in outcome.outside],
        "colours": sorted({depth for depth in layout.depths if depth is not None}),
        "empty": [name for name, _ in outcome.empty],
        "damaged": [[name, reason] for name, reason in outcome.damaged],
        "remarks": [text for part in outcome.opened for text in part.stream.remarks],
    }
    return values, Facts(counts, tuple(warnings), notes)
