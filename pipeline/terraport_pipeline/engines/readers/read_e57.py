"""E57 (ASTM E2807) by pye57's libe57: every scan, with its pose applied.

All fields of all scans are kept; a field that only some scans have is NaN in the others. With more
than one scan, the attribute ``scan`` says which one a point belongs to. Points marked invalid by
the scanner are left out.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from pye57 import ScanHeader, libe57
from pyproj import CRS
from pyproj.exceptions import CRSError

from terraport_payload.types import AnyArray, Float64, Int64
from terraport_pipeline.engines.readers.raw_survey import (
    Advance,
    RawSurvey,
    StreamChunk,
    tell_precision,
    thinning_rows,
    to_eight_bits,
)
from terraport_pipeline.errors import ReadError

__all__ = ["E57Stream", "open_e57", "read_e57"]

_CHUNK_POINTS: Final = 500_000

_CARTESIAN: Final = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL: Final = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_INVALID: Final = ("cartesianInvalidState", "sphericalInvalidState")
_COLOURS: Final = ("colorRed", "colorGreen", "colorBlue")

_MAX_POINTS_PER_BYTE: Final = 64
"""E57 packs bits; a point of less than an eighth of a bit holds no coordinates."""

_AGAIN: Final = "the file is cut off or damaged: copy or export it again"


def read_e57(path: Path, *, advance: Advance, max_points: int | None = None) -> RawSurvey:
    """Read an E57 file.

    Parameters
    ----------
    path : pathlib.Path
    advance : callable
        Told of progress.
    max_points : int, optional
        Thin to this many points, counted over all scans before invalid ones are left out.

    Raises
    ------
    ReadError
        When the file is damaged (E57 has a checksum per kilobyte), has no points, or a scan has no
        coordinates; names the scan.
    """
    try:
        image = libe57.ImageFile(str(path), "r")
    except (libe57.E57Exception, RuntimeError) as error:
        raise ReadError(path, f"the E57 file cannot be opened ({_brief(error)})", _AGAIN) from error
    try:
        return _read_image(path, image, advance, max_points)
    except (libe57.E57Exception, RuntimeError) as error:
        raise ReadError(path, f"the E57 file cannot be read ({_brief(error)})", _AGAIN) from error
    finally:
        image.close()


@dataclass(frozen=True, slots=True, eq=False)
class E57Stream:
    """An open file; its points come in parts, scan by scan."""

    count: int
    crs: Any | None
    warnings: tuple[str, ...]
    late_warnings: Callable[[], tuple[str, ...]]
    """Known when all parts were read."""
    colours: tuple[str, ...]
    chunks: Callable[[], Iterator[StreamChunk]]
    """Makes the iterator; once."""


@contextlib.contextmanager
def open_e57(path: Path, *, max_points: int | None = None) -> Iterator[E57Stream]:
    """Open a file for reading in parts of half a million points.

    Parameters
    ----------
    path : pathlib.Path
    max_points : int, optional
        Thin to this many points, counted over all scans before invalid ones are left out.

    Raises
    ------
    ReadError
        As :func:`read_e57`; what is damaged in the points is found while the parts are read.
    """
    try:
        image = libe57.ImageFile(str(path), "r")
    except (libe57.E57Exception, RuntimeError) as error:
        raise ReadError(path, f"the E57 file cannot be opened ({_brief(error)})", _AGAIN) from error
    try:
        yield _stream_image(path, image, max_points)
    except (libe57.E57Exception, RuntimeError) as error:
        raise ReadError(path, f"the E57 file cannot be read ({_brief(error)})", _AGAIN) from error
    finally:
        image.close()


def _stream_image(path: Path, image: Any, max_points: int | None) -> E57Stream:
    # (1) What the scans hold; a field of any scan is a column, NaN in the others.
    root = image.root()
    headers, counts = _scans(path, root)
    total = sum(counts)
    rows = thinning_rows(total, max_points)
    fields = [
        [name for name in header.point_fields if name not in (*_shape(path, header, n), *_INVALID)]
        for n, (header, count) in enumerate(zip(headers, counts, strict=True))
        if count
    ]
    if len(headers) > 1:
        fields = [[*names, "scan"] for names in fields]
    names = list(dict.fromkeys(name for scan in fields for name in scan))
    partial = [name for name in names if any(name not in scan for scan in fields)]
    late: list[str] = []
    invalid = 0

    # (2) Scan after scan. Invariant: `start` is the number of points of the scans before, which
    # the rows of a thinned survey count from.
    def chunks() -> Iterator[StreamChunk]:
        nonlocal invalid
        start = 0
        for number, (header, count) in enumerate(zip(headers, counts, strict=True)):
            if count == 0:
                continue
            own = None
            if rows is not None:
                low, high = np.searchsorted(rows, (start, start + count))
                own = rows[low:high] - start
            precision = _Precision()
            for points, table, got in _scan_parts(path, image, header, number, own, precision):
                bad = next((table.pop(name) for name in _INVALID if name in table), None)
                for name in _INVALID:
                    table.pop(name, None)
                good = np.ones(len(points), dtype=bool) if bad is None else bad == 0
                invalid += int(np.count_nonzero(~good))
                table["scan"] = np.full(len(points), number, dtype=np.float64)
                nothing = np.full(len(points), np.nan)
                columns = {name: table.get(name, nothing)[good] for name in names}
                yield StreamChunk(points[good], columns, got)
            late[:] = late or precision.warnings()
            start += count

    def late_warnings() -> tuple[str, ...]:
        if not invalid:
            return tuple(late)
        return (*late, f"{invalid:,} points that the scanner marked invalid were left out.")

    # (3) What is worth saying before a point is read.
    has_colour = all(name in names for name in _COLOURS)
    warnings: tuple[str, ...] = ()
    if has_colour and any(name in partial for name in _COLOURS):
        warnings += ("Some scans have no colour; their points are black.",)
    partial = [name for name in partial if not (has_colour and name in _COLOURS)]
    if partial:
        warnings += (f"Not every scan has {', '.join(partial)}; it is NaN in the others.",)
    return E57Stream(
        total, _find_crs(root), warnings, late_warnings, _COLOURS if has_colour else (), chunks
    )


class _Precision:
    """Whether a scan's coordinates, as stored, went through 32-bit floats."""

    def __init__(self) -> None:
        self._single = np.ones(3, dtype=bool)
        self._top = np.zeros(3)

    def look(self, points: Float64) -> None:
        points = points[np.isfinite(points).all(axis=1)]
        if len(points):
            self._single &= np.array([(p.astype(np.float32) == p).all() for p in points.T])
            self._top = np.maximum(self._top, np.abs(points).max(axis=0))

    def warnings(self) -> list[str]:
        return list(tell_precision(self._single, self._top))


def _scans(path: Path, root: Any) -> tuple[list[Any], list[int]]:
    """Headers of all scans and their numbers of points; refuses absurd ones."""
    scans = root["data3D"] if root.isDefined("data3D") else []
    headers = [ScanHeader(scans[index]) for index in range(len(scans))]
    counts = [int(header.point_count) for header in headers]
    total = sum(counts)
    if total == 0:
        raise ReadError(path, f"{len(headers)} scans with 0 points", "export the survey again")
    if total > _MAX_POINTS_PER_BYTE * path.stat().st_size:
        raise ReadError(path, f"{total:,} points in {path.stat().st_size:,} bytes", _AGAIN)
    return headers, counts


def _shape(path: Path, header: Any, number: int) -> tuple[str, str, str]:
    """Fields that hold a scan's coordinates."""
    fields = list(header.point_fields)
    shape = next((s for s in (_CARTESIAN, _SPHERICAL) if all(n in fields for n in s)), None)
    if shape is None:
        raise ReadError(
            path,
            f"scan {number} has neither cartesian nor spherical coordinates; its fields are "
            f"{', '.join(fields)}",
            "export the survey again",
        )
    return shape


def _scan_parts(
    path: Path,
    image: Any,
    header: Any,
    number: int,
    rows: Int64 | None,
    precision: _Precision,
) -> Iterator[tuple[Float64, dict[str, AnyArray], int]]:
    """Yield (points with the pose applied, every other field, points read) of one scan."""
    # (1) One buffer per field, filled again for each chunk.
    fields = list(header.point_fields)
    shape = _shape(path, header, number)
    count = int(header.point_count)
    size = min(_CHUNK_POINTS, count)
    buffers = libe57.VectorSourceDestBuffer()
    chunk = {name: np.empty(size, dtype=np.float64) for name in fields}
    for name in fields:
        buffers.append(libe57.SourceDestBuffer(image, name, chunk[name], size, True, True))
    reader = header.points.reader(buffers)
    # (2) Chunks. Invariant: `first` points of the scan are read; `rows` count from the scan's
    # start.
    first = 0
    while first < count:
        got = int(reader.read())
        if got == 0:
            raise ReadError(
                path,
                f"scan {number} ends after {first:,} of {count:,} points",
                _AGAIN,
                f"point {first:,}",
            )
        wanted: Any = slice(0, got)
        if rows is not None:
            low, high = np.searchsorted(rows, (first, first + got))
            wanted = rows[low:high] - first
        table = {name: chunk[name][wanted].copy() for name in fields}
        # (3) Cartesian; precision is judged before the pose moves the scan among the others.
        points = np.stack([table.pop(name) for name in shape], axis=1)
        if shape is _SPHERICAL:
            points = _from_spherical(points)
        precision.look(points)
        if header.has_pose():
            points = points @ np.asarray(header.rotation_matrix).T + np.asarray(header.translation)
        yield points, table, got
        first += got
    reader.close()


def _read_image(path: Path, image: Any, advance: Advance, max_points: int | None) -> RawSurvey:
    root = image.root()
    headers, counts = _scans(path, root)
    total = sum(counts)
    rows = thinning_rows(total, max_points)
    tables, invalid, start = [], 0, 0
    coarse: tuple[str, ...] = ()
    for number, (header, count) in enumerate(zip(headers, counts, strict=True)):
        if count == 0:
            continue
        own = None
        # Rows of a thinned survey count over all scans.
        if rows is not None:
            low, high = np.searchsorted(rows, (start, start + count))
            own = rows[low:high] - start
        table, notes = _read_scan(path, image, header, number, own, lambda n: advance(n, total))
        coarse = coarse or notes
        # Points that the scanner marked invalid.
        bad = next((table.pop(name) for name in _INVALID if name in table), None)
        for name in _INVALID:
            table.pop(name, None)
        if bad is not None and bad.any():
            invalid += int(np.count_nonzero(bad))
            table = {name: values[bad == 0] for name, values in table.items()}
        if len(headers) > 1:
            table["scan"] = np.full(len(table["x"]), number, dtype=np.float64)
        tables.append(table)
        start += count
    warnings = coarse
    if invalid:
        warnings += (f"{invalid:,} points that the scanner marked invalid were left out.",)
    return _assemble(tables, _find_crs(root), warnings)


def _read_scan(
    path: Path,
    image: Any,
    header: Any,
    number: int,
    rows: Int64 | None,
    advance: Any,
) -> tuple[dict[str, AnyArray], tuple[str, ...]]:
    """Read one scan: x, y, z in the file's frame and every other field; and warnings."""
    precision = _Precision()
    tables = []
    for points, table, got in _scan_parts(path, image, header, number, rows, precision):
        table["x"], table["y"], table["z"] = points.T
        tables.append(table)
        advance(got)
    whole = {
        name: np.concatenate([table_of_chunk[name] for table_of_chunk in tables])
        for name in tables[0]
    }
    return whole, tuple(precision.warnings())


def _from_spherical(values: Float64) -> Float64:
    """Convert (range, azimuth, elevation), ASTM E2807 8.3.2, to x, y, z."""
    distance, azimuth, elevation = values.T
    flat = distance * np.cos(elevation)
    return np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), distance * np.sin(elevation)], axis=1
    )


def _find_crs(root: Any) -> Any | None:
    """Read the CRS from coordinateMetadata, which the standard leaves as free text (WKT mostly)."""
    if not root.isDefined("coordinateMetadata"):
        return None
    text = str(root["coordinateMetadata"].value()).strip()
    try:
        return CRS.from_user_input(text) if text else None
    except CRSError:
        return None


def _assemble(
    tables: list[dict[str, AnyArray]], crs: Any | None, warnings: tuple[str, ...]
) -> RawSurvey:
    names = list(dict.fromkeys(name for table in tables for name in table))
    columns: dict[str, AnyArray] = {}
    for name in names:
        pieces = [
            table.get(name, np.full(len(table["x"]), np.nan, dtype=np.float64)) for table in tables
        ]
        columns[name] = np.concatenate(pieces)
    partial = [name for name in names if any(name not in table for table in tables)]
    points = np.stack([columns.pop(axis) for axis in "xyz"], axis=1)
    colours = None
    if all(name in columns for name in _COLOURS):
        parts3 = np.stack([columns.pop(name) for name in _COLOURS], axis=1)
        colours, notes = to_eight_bits(parts3, where=", ".join(_COLOURS))
        warnings += notes
        if any(name in partial for name in _COLOURS):
            warnings += ("Some scans have no colour; their points are black.",)
    partial = [name for name in partial if name in columns]
    if partial:
        warnings += (f"Not every scan has {', '.join(partial)}; it is NaN in the others.",)
    attributes = {name: _narrow(values) for name, values in columns.items()}
    return RawSurvey(points, colours, attributes, crs, warnings)


def _narrow(values: Float64) -> AnyArray:
    """Give whole numbers an integer type again; others stay float64 (timestamps need it)."""
    if len(values) and np.isfinite(values).all() and (values == np.rint(values)).all():
        low, high = values.min(), values.max()
        for code in (np.uint8, np.uint16, np.int32):
            if np.iinfo(code).min <= low and high <= np.iinfo(code).max:
                return values.astype(code)
    return values


def _brief(error: BaseException) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__
