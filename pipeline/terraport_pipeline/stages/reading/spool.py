"""The first pass of reading: every file's points as rows on disk, and what is noted of each file.

Rows hold what the file has, in its types; what only the whole survey can decide comes later
(:mod:`.layout`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, Bool, Float64
from terraport_pipeline.engines.readers.height_edges import MAX_HEIGHT, HeightEdges
from terraport_pipeline.engines.readers.npy_columns import NpyWriter
from terraport_pipeline.engines.readers.point_order import HashThinning, point_hashes
from terraport_pipeline.engines.readers.survey_chunk import StreamChunk
from terraport_pipeline.engines.readers.survey_colours import ColourCounts
from terraport_pipeline.engines.readers.survey_column import SurveyColumn, without_extremes
from terraport_pipeline.engines.readers.survey_stream import SurveyStream, open_stream
from terraport_pipeline.errors import NoPointsError, ReadError, SurveyError
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.survey.one_survey import damage_of, listed, nothing_within, one_crs
from terraport_pipeline.survey.survey_files import SurveyFile, SurveyFiles

__all__ = ["BLOCK_ROWS", "COLOUR", "Outcome", "Spooled", "spool_all", "widen"]

BLOCK_ROWS: Final = 500_000
"""Rows in memory at once while they are read again and handed out to buckets."""

_SAMPLE_STEP: Final = 2000
"""One point in so many says where buckets begin: 500 samples a bucket make them equal to 5 %."""

COLOUR: Final = "\0colour"
"""Name of the colour columns as one: no field can be called so."""


@dataclass(slots=True)
class Spooled:
    """One file as rows on disk, and what is known of it."""

    file: SurveyFile
    path: Path
    stream: SurveyStream
    fields: dict[str, str]
    """Name of every column's field in the rows."""
    columns: dict[str, SurveyColumn]
    writer: NpyWriter
    colours: dict[int, ColourCounts] = field(default_factory=dict)
    """Colour statistics by scan; without scans, those of scan 0; empty without colours."""
    read: int = 0
    kept: int = 0
    dropped: int = 0
    """Points without finite coordinates."""
    noise: int = 0
    """Points left out because the file calls them no part of the survey."""
    voids: int = 0
    """Number of points whose height means "no data"."""
    heights: HeightEdges = field(default_factory=HeightEdges)
    low: Float64 = field(default_factory=lambda: np.full(3, np.inf))
    high: Float64 = field(default_factory=lambda: np.full(3, -np.inf))
    single: Bool = field(default_factory=lambda: np.ones(3, dtype=bool))
    warnings: tuple[str, ...] = ()
    samples: list[Float64] = field(default_factory=list)
    strays: int = 0
    """Points that lie so far from all others that they are left out."""
    repeats: int = 0
    """Its points that a file before it has, too, or that are in it twice."""

    def look_at_colours(self, colours: AnyArray, scan: int) -> None:
        """Update with the colours of more points."""
        if scan not in self.colours:
            self.colours[scan] = ColourCounts(self.stream.colour_limits.get(scan))
        self.colours[scan].look(colours)

    def look(self, points: Float64) -> None:
        """Take further finite points into account."""
        self.kept += len(points)
        if len(points):
            self.heights.look(points[:, 2])
            self.low = np.minimum(self.low, points.min(axis=0))
            self.high = np.maximum(self.high, points.max(axis=0))
            self.single &= np.array([(p.astype(np.float32) == p).all() for p in points.T])


@dataclass(frozen=True, slots=True)
class Outside:
    """A file without a point within the extent."""

    file: SurveyFile
    stream: SurveyStream
    read: int
    dropped: int
    box: tuple[Any, Any]
    """Corners of its points, or None twice."""


@dataclass(slots=True)
class Outcome:
    """What came of all files."""

    spooled: list[Spooled] = field(default_factory=list)
    outside: list[Outside] = field(default_factory=list)
    empty: list[tuple[str, str]] = field(default_factory=list)
    """Name and reason of files without points."""
    damaged: list[tuple[str, str]] = field(default_factory=list)

    @property
    def opened(self) -> list[Spooled | Outside]:
        """All files that were read."""
        return [*self.spooled, *self.outside]


def spool_all(
    survey: SurveyFiles,
    folder: Path,
    context: Context,
    thinning: HashThinning | None,
    bounded: bool,
    share: float,
) -> Outcome:
    """Write every file down."""
    outcome = Outcome()
    first_error: ReadError | None = None
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
            first_error = first_error or error
            outcome.damaged.append((file.name, error.reason))
            path.unlink(missing_ok=True)
        else:
            if isinstance(part, Outside):
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
        stated = [(part.file.name, part.stream.crs) for part in outcome.outside]
        crs = one_crs(stated, statement=survey.statement)
        boxes = [part.box for part in outcome.outside]
        raise nothing_within(survey.title, survey.extent, boxes, crs)
    names = listed([name for name, _ in (*outcome.damaged, *outcome.empty)])
    reason = "" if first_error is None else f"; {first_error}"
    raise SurveyError(f"{survey.title}: not one of its files can be used: {names}{reason}")


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
) -> Spooled | Outside:
    """Write a file's points within the extent down as it has them, those that are finite.

    Nothing is noted of points outside the extent: what is decided from the columns is the same
    whether an index leaves them out or not.
    """
    part: Spooled | None = None
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
            # (1) Select points. Invariant: read = kept + dropped + noise + voids + those
            # outside.
            columns = _columns_of(chunk, stream)
            if part is None:
                part = _open_rows(file, path, stream, columns)
            part.read += len(chunk.points)
            taken = np.isfinite(chunk.points).all(axis=1)
            part.dropped += len(chunk.points) - int(taken.sum())
            if extent is not None:
                widen(box, chunk.points[taken])
                taken &= extent.holds(chunk.points)
            if chunk.noise is not None and not survey.statement.keep_noise:
                part.noise += int((taken & chunk.noise).sum())
                taken &= ~chunk.noise
            is_void = taken & (np.abs(chunk.points[:, 2]) >= MAX_HEIGHT)
            part.voids += int(is_void.sum())
            taken &= ~is_void
            # (2) What they are: position, columns.
            points = (chunk.points if taken.all() else chunk.points[taken]) + 0.0  # no -0.0
            part.look(points)
            rows: AnyArray = np.empty(len(points), part.writer.dtype)
            rows["position"] = points
            for name, values in columns.items():
                good = values if taken.all() else values[taken]
                if name == COLOUR:
                    part.look_at_colours(good, chunk.scan)
                else:
                    good, extremes = without_extremes(good)
                    part.columns[name].extremes += extremes
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
    read, dropped, noise = (0, 0, 0) if part is None else (part.read, part.dropped, part.noise)
    if noise:
        raise NoPointsError(
            file.path,
            f"{noise:,} of {read:,} points are marked as withheld or as noise; no other is left",
            "--keep-noise takes them",
        )
    if part is not None and part.voids:
        raise NoPointsError(
            file.path,
            f"{part.voids:,} of {read:,} points have a height beyond {MAX_HEIGHT:.0e}, which "
            "stands for no data; no other is left",
            "export the survey with heights",
        )
    if extent is not None and (stream.skipped or read > dropped):
        corners = stream.box or (box if read > dropped else (None, None))
        return Outside(file, _bare(stream), read, dropped, corners)
    raise ReadError(
        file.path,
        f"not one of {read:,} points has finite coordinates",
        "export the survey again",
    )


def widen(box: tuple[Float64, Float64], points: Float64) -> None:
    """Widen a box so that it holds some points."""
    if len(points):
        np.minimum(box[0], points.min(axis=0), out=box[0])
        np.maximum(box[1], points.max(axis=0), out=box[1])


def _open_rows(
    file: SurveyFile, path: Path, stream: SurveyStream, columns: Mapping[str, AnyArray]
) -> Spooled:
    fields = {name: f"f{number}" for number, name in enumerate(columns)}
    row: list[Any] = [("position", "<f8", (3,))]
    row += [(fields[name], values.dtype, values.shape[1:]) for name, values in columns.items()]
    known = {
        name: SurveyColumn(values.dtype, tuple(stream.unset.get(name, ())), stream.narrow)
        for name, values in columns.items()
    }
    return Spooled(file, path, _bare(stream), fields, known, NpyWriter(path, np.dtype(row)))


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
        out[COLOUR] = channels[0] if len(channels) == 1 else np.stack(channels, axis=1)
    for name, values in chunk.columns.items():
        if has_colour and name in stream.colours:
            continue
        if values.ndim == 1:
            out[name] = values
        else:
            for component in range(values.shape[1]):
                own = f"{name}_{component}"
                taken = own in chunk.columns or own in out
                out[f"{name}[{component}]" if taken else own] = values[:, component]
    return out
