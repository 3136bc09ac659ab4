"""Read a survey that does not fit into memory: file to columns on disk, a part at a time.

The result is what :mod:`~terraport_pipeline.stages.read` makes of the same file, bit for bit:
points without finite coordinates are dropped and counted, feet become metres, unset fields are left
out. What only the whole survey decides is found on the way and applied in a second pass over the
columns that need it. Memory: one part (about 100 MB), whatever the survey.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from terraport_payload.types import AnyArray, Bool, Float64
from terraport_pipeline.engines.readers.npy_columns import NpyReader, NpyWriter
from terraport_pipeline.engines.readers.raw_survey import (
    StreamChunk,
    apply_depth,
    choose_depth,
    tell_precision,
)
from terraport_pipeline.engines.readers.survey_crs import metre_factors
from terraport_pipeline.engines.readers.survey_stream import SurveyStream, open_stream
from terraport_pipeline.errors import ReadError
from terraport_pipeline.stages.contract import Context, Facts, Json
from terraport_pipeline.stages.read import MAX_SPAN_M, find_format

__all__ = ["NAME", "run"]

NAME: Final = "read"

_BLOCK_ROWS: Final = 1_000_000
"""Rows of one column that the second pass holds: 24 MB at most."""


@dataclass(slots=True)
class _Column:
    """What is known of a column after all parts."""

    writer: NpyWriter
    low: float = np.inf
    high: float = -np.inf
    first: Any = None
    constant: bool = True
    whole: bool = True
    """Finite whole numbers only."""

    def look(self, values: AnyArray) -> None:
        if not len(values):
            return
        if self.first is None:
            self.first = values.flat[0]
        self.constant = self.constant and bool((values == self.first).all())
        if values.dtype.kind == "f":
            finite = values[np.isfinite(values)]
            self.whole = self.whole and len(finite) == values.size
            self.whole = self.whole and bool((finite == np.rint(finite)).all())
        else:
            finite = values
        if finite.size:
            self.low = min(self.low, float(finite.min()))
            self.high = max(self.high, float(finite.max()))


@dataclass(slots=True)
class _Points:
    """What is known of the coordinates."""

    writer: NpyWriter
    read: int = 0
    low: Float64 = field(default_factory=lambda: np.full(3, np.inf))
    high: Float64 = field(default_factory=lambda: np.full(3, -np.inf))
    single: Bool = field(default_factory=lambda: np.ones(3, dtype=bool))

    def look(self, points: Float64) -> None:
        if len(points):
            self.low = np.minimum(self.low, points.min(axis=0))
            self.high = np.maximum(self.high, points.max(axis=0))
            self.single &= np.array([(p.astype(np.float32) == p).all() for p in points.T])


def run(
    path: Path, folder: Path, context: Context, *, max_points: int | None = None
) -> tuple[Mapping[str, Json], Facts]:
    """Read a survey into a folder.

    Parameters
    ----------
    path : pathlib.Path
        The survey.
    folder : pathlib.Path
        Gets ``points.npy``, ``colours.npy`` and ``attribute-<i>.npy``, as
        :mod:`~terraport_pipeline.stages.survey_store` names them.
    context : Context
    max_points : int, optional
        Thin to this many points.

    Returns
    -------
    values, facts
        As :func:`terraport_pipeline.stages.survey_store.store` and ``facts_of`` make them, and the
        box in ``low`` and ``high``.

    Raises
    ------
    ReadError
        As :func:`terraport_pipeline.stages.read.read_survey`, or the format cannot be read in
        parts.
    """
    name = find_format(path)
    try:
        with open_stream(path, name, max_points=max_points) as stream:
            points, columns = _spool(stream, path, folder, context)
            return _finish(path, stream, points, columns, folder)
    except OSError as error:
        if error.errno is not None and error.filename is None:
            raise  # our own writing: a full disk, named by the caller
        raise ReadError(path, f"the file cannot be read ({error})", "check the disk") from error


def _spool(
    stream: SurveyStream, path: Path, folder: Path, context: Context
) -> tuple[_Points, dict[str, _Column]]:
    """Write everything down as the file has it."""
    context.progress.start(f"read {path.name}", stream.total, stream.unit)
    points = _Points(NpyWriter(folder / "raw-points.npy", np.float64, (3,)))
    columns: dict[str, _Column] = {}
    for chunk in stream.chunks():
        finite = np.isfinite(chunk.points).all(axis=1)
        good = chunk.points if finite.all() else chunk.points[finite]
        points.read += len(chunk.points)
        points.look(good)
        points.writer.append(good)
        for name, values in _columns_of(chunk, stream).items():
            if name not in columns:
                target = folder / f"raw-{len(columns)}.npy"
                columns[name] = _Column(NpyWriter(target, values.dtype, values.shape[1:]))
            columns[name].look(values)
            columns[name].writer.append(values if finite.all() else values[finite])
        context.progress.advance(chunk.read)
    points.writer.close()
    for column in columns.values():
        column.writer.close()
    context.progress.done({"points": points.writer.rows})
    return points, columns


_COLOURS: Final = "\0colours"
"""Name of the three colour columns as one: no field can be called so."""


def _columns_of(chunk: StreamChunk, stream: SurveyStream) -> dict[str, AnyArray]:
    """Take the colours together; give each part of a vector field its own name."""
    out: dict[str, AnyArray] = {}
    has_colour = bool(stream.colours) and all(name in chunk.columns for name in stream.colours)
    if has_colour:
        channels = [chunk.columns[name] for name in stream.colours]
        wide = channels[0] if len(channels) == 1 else np.stack(channels, axis=1)
        if wide.dtype.kind == "f":
            valid: Bool = np.all(np.isfinite(wide), axis=1)
            wide = np.where(valid[:, None], wide, wide.dtype.type(0))
        out[_COLOURS] = wide
    for name, values in chunk.columns.items():
        if has_colour and name in stream.colours:
            continue
        if values.ndim == 1:
            out[name] = values
        else:
            for component in range(values.shape[1]):
                out[f"{name}_{component}"] = values[:, component]
    return out


def _finish(
    path: Path,
    stream: SurveyStream,
    points: _Points,
    columns: dict[str, _Column],
    folder: Path,
) -> tuple[Mapping[str, Json], Facts]:
    """Decide what only the whole survey can decide, and bring the columns to their last form."""
    # (1) Refuse a survey without a single point.
    warnings = [*stream.late_warnings(), *stream.warnings]
    count = points.writer.rows
    if not count:
        raise ReadError(
            path,
            f"not one of {points.read:,} points has finite coordinates",
            "export the survey again",
        )
    # (2) Colours and attributes; columns that the format fills with its default are dropped.
    colours = columns.pop(_COLOURS, None)
    has_colour = False
    if colours is not None:
        has_colour = _finish_colours(stream, colours, folder, warnings)
    names: list[str] = []
    for name, column in columns.items():
        unset = name in stream.unset and column.first in stream.unset[name]
        if not (unset and column.constant):
            target = folder / f"attribute-{len(names)}.npy"
            _rewrite(column.writer.path, target, _narrowed(column) if stream.narrow else None)
            names.append(name)
        column.writer.path.unlink(missing_ok=True)
    # (3) Positions: damaged, too coarse, or in another unit than the metre.
    if points.read > count:
        lost = points.read - count
        warnings.append(f"{lost:,} of {points.read:,} points have no finite coordinates: dropped.")
    span = float((points.high - points.low).max())
    if span > MAX_SPAN_M:
        raise ReadError(
            path,
            f"the coordinates span {span:.3g}, expected less than {MAX_SPAN_M:.0e} metres",
            "some are damaged: remove them or export the survey again",
        )
    if not stream.stated_step:
        warnings += tell_precision(
            points.single, np.maximum(np.abs(points.low), np.abs(points.high))
        )
    factors, crs, notes = metre_factors(path, points.low, points.high, stream.crs)
    warnings += notes
    # (4) The positions' file, scaled block by block where the unit is not the metre.
    low, high = points.low, points.high
    if factors is None:
        points.writer.path.rename(folder / "points.npy")
    else:
        low, high = low * factors, high * factors
        with NpyWriter(folder / "points.npy", np.float64, (3,)) as scaled:
            for _, block in NpyReader(points.writer.path).blocks(_BLOCK_ROWS):
                scaled.append(block * factors)
        points.writer.path.unlink()
    if not has_colour:
        warnings.append("The survey has no colour (RGB): what no photo shows will be grey.")
    values = {
        "attributes": names,
        "crs": {"name": crs.name, "wkt": crs.wkt, "epsg": crs.epsg} if crs else None,
        "format": stream.format,
    }
    counts = {
        "points": count,
        "has_colour": has_colour,
        "attributes": len(names),
        "format": stream.format,
        "crs": crs.name if crs else None,
        "low": low.tolist(),
        "high": high.tolist(),
    }
    return values, Facts(counts, tuple(warnings))


def _finish_colours(
    stream: SurveyStream, column: _Column, folder: Path, warnings: list[str]
) -> bool:
    where = ", ".join(stream.colours)
    rule, notes = choose_depth(column.low, column.high, column.writer.dtype, where=where)
    if stream.format == "las" and rule == "eight":
        notes = (
            *notes,
            "The colours use only 8 of the 16 bits that LAS gives them; they are taken as 0..255.",
        )
    warnings += notes
    if rule is not None:
        with NpyWriter(folder / "colours.npy", np.uint8, (3,)) as scaled:
            for _, block in NpyReader(column.writer.path).blocks(_BLOCK_ROWS):
                scaled.append(apply_depth(block, rule))
    column.writer.path.unlink()
    return rule is not None


def _narrowed(column: _Column) -> npt.DTypeLike | None:
    """Smallest integer type of a column of whole numbers; None when it stays as it is."""
    if column.writer.dtype.kind == "f" and column.whole and column.first is not None:
        for code in (np.uint8, np.uint16, np.int32):
            if np.iinfo(code).min <= column.low and column.high <= np.iinfo(code).max:
                return code
    return None


def _rewrite(source: Path, target: Path, dtype: npt.DTypeLike | None) -> None:
    if dtype is None:
        source.rename(target)
        return
    with NpyWriter(target, dtype) as writer:
        for _, block in NpyReader(source).blocks(_BLOCK_ROWS):
            writer.append(block.astype(dtype))
