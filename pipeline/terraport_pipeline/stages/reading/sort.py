"""The second and third pass of reading: rows to buckets along the curve, buckets to columns.

A bucket is sorted in memory; rows that repeat another in every value are taken once, and the
survey is thinned where that was asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray, Float64, Int64
from terraport_pipeline.engines.readers.npy_columns import NpyReader, NpyWriter
from terraport_pipeline.engines.readers.point_order import (
    HashThinning,
    curve_keys,
    order_rows,
    point_hashes,
    thinning_rows,
)
from terraport_pipeline.engines.readers.survey_colours import GREY
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.reading.layout import Layout
from terraport_pipeline.stages.reading.spool import BLOCK_ROWS, COLOUR, Spooled
from terraport_pipeline.stages.reading.strays import PointFilter
from terraport_store import SurveyUnits

__all__ = ["SurveyColumns", "distribute", "finish"]

_BUCKET_ROWS: Final = 1_000_000
"""Rows of a bucket, about; a bucket is sorted in memory."""


def distribute(
    spooled: Sequence[Spooled],
    layout: Layout,
    low: Float64,
    high: Float64,
    folder: Path,
    context: Context,
    thinning: HashThinning | None,
    taken: PointFilter,
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
        for _, raw in NpyReader(part.path).blocks(BLOCK_ROWS):
            context.progress.advance(len(raw))
            inside = taken.holds(raw["position"])
            raw = raw if inside.all() else raw[inside]
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


def _converted(raw: AnyArray, number: int, part: Spooled, layout: Layout) -> AnyArray:
    """Bring a file's rows to the survey's columns."""
    rows: AnyArray = np.empty(len(raw), layout.row)
    rows["file"] = number
    rows["position"] = raw["position"]
    if layout.has_colour:
        rows["colour"] = GREY
        scan_field = part.fields.get(part.stream.scan_column or "")
        for scan, rule in layout.colours[number].items():
            of_scan = slice(None) if scan_field is None else raw[scan_field] == scan
            rows["colour"][of_scan] = rule.apply(raw[part.fields[COLOUR]][of_scan])
    for i, name in enumerate(layout.sources):
        rows[f"a{i}"] = raw[part.fields[name]] if name in part.fields else layout.fills[i]
    return rows


class SurveyColumns:
    """The survey's columns, written row by row in metres."""

    def __init__(self, folder: Path, layout: Layout, units: SurveyUnits | None) -> None:
        self.layout, self.units = layout, units
        self._points = NpyWriter(folder / "points.npy", np.float64, (3,))
        self._colours = (
            NpyWriter(folder / "colours.npy", np.uint8, (3,)) if layout.has_colour else None
        )
        self._attributes = [
            NpyWriter(folder / f"attribute-{i}.npy", dtype) for i, dtype in enumerate(layout.dtypes)
        ]
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)
        self.brightness: Int64 = np.zeros((len(layout.colours), 256), np.int64)
        """Histogram of the points' brightest channel, for each file."""

    @property
    def rows(self) -> int:
        """Points written."""
        return self._points.rows

    def append(self, rows: AnyArray) -> None:
        """Write further rows."""
        if not len(rows):
            return
        points = np.ascontiguousarray(rows["position"])
        if self.units is not None:
            points = self.units.to_metres(points)
        self.low = np.minimum(self.low, points.min(axis=0))
        self.high = np.maximum(self.high, points.max(axis=0))
        self._points.append(points)
        if self._colours is not None:
            self._colours.append(rows["colour"])
            code = rows["file"].astype(np.int64) * 256 + rows["colour"].max(axis=1)
            counts = np.bincount(code, minlength=self.brightness.size)
            self.brightness += counts.reshape(self.brightness.shape)
        for i, writer in enumerate(self._attributes):
            writer.append(rows[f"a{i}"])

    def close(self) -> None:
        """Finish all files."""
        for writer in (self._points, self._colours, *self._attributes):
            if writer is not None:
                writer.close()


def finish(
    buckets: Sequence[NpyWriter],
    spooled: Sequence[Spooled],
    columns: SurveyColumns,
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
        for first, block in NpyReader(whole.path).blocks(BLOCK_ROWS):
            if chosen is not None:
                begin, end = np.searchsorted(chosen, (first, first + len(block)))
                block = block[chosen[begin:end] - first]
            columns.append(block)
        whole.path.unlink()
    columns.close()
    context.progress.done({"points": columns.rows})


def _sorted(
    buckets: Sequence[NpyWriter],
    spooled: Sequence[Spooled],
    layout: Layout,
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
