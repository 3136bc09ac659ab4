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

from terraport_payload.types import AnyArray, Float64
from terraport_pipeline.engines.readers.survey_chunk import StreamChunk, tell_precision
from terraport_pipeline.errors import ReadError

__all__ = ["E57Stream", "open_e57"]

_CHUNK_POINTS: Final = 500_000

_CARTESIAN: Final = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL: Final = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_INVALID: Final = ("cartesianInvalidState", "sphericalInvalidState")
_COLOURS: Final = ("colorRed", "colorGreen", "colorBlue")

_MAX_POINTS_PER_BYTE: Final = 64
"""E57 packs bits; a point of less than an eighth of a bit holds no coordinates."""

_AGAIN: Final = "the file is cut off or damaged: copy or export it again"


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
def open_e57(path: Path) -> Iterator[E57Stream]:
    """Open a file for reading in parts of half a million points.

    Raises
    ------
    ReadError
        When the file is damaged, has no points, or a scan has no coordinates; names the scan. E57
        has a checksum per kilobyte: damage in the points is found while the parts are read.
    """
    try:
        image = libe57.ImageFile(str(path), "r")
    except (libe57.E57Exception, RuntimeError) as error:
        raise ReadError(path, f"the E57 file cannot be opened ({_brief(error)})", _AGAIN) from error
    try:
        yield _stream_image(path, image)
    except (libe57.E57Exception, RuntimeError) as error:
        raise ReadError(path, f"the E57 file cannot be read ({_brief(error)})", _AGAIN) from error
    finally:
        image.close()


def _stream_image(path: Path, image: Any) -> E57Stream:
    # (1) What the scans hold; a field of any scan is a column, NaN in the others.
    root = image.root()
    headers, counts = _scans(path, root)
    total = sum(counts)
    fields = [
        [name for name in header.point_fields if name not in (*_shape(path, header, n), *_INVALID)]
        for n, (header, count) in enumerate(zip(headers, counts, strict=True))
        if count
    ]
    if len(headers) > 1:
        fields = [[*names, "scan"] for names in fields]
    names = list(dict.fromkeys(name for scan in fields for name in scan))
    partial = [name for name in names if any(name not in scan for scan in fields)]
    precisions: list[_Precision] = []
    invalid = 0

    # (2) Scan after scan; points that the scanner marked invalid are counted, not handed out.
    def chunks() -> Iterator[StreamChunk]:
        nonlocal invalid
        for number, (header, count) in enumerate(zip(headers, counts, strict=True)):
            if count == 0:
                continue
            precisions.append(precision := _Precision())
            for points, table in _scan_parts(path, image, header, number, precision):
                bad = next((table.pop(name) for name in _INVALID if name in table), None)
                for name in _INVALID:
                    table.pop(name, None)
                good = np.ones(len(points), dtype=bool) if bad is None else bad == 0
                invalid += int(np.count_nonzero(~good))
                table["scan"] = np.full(len(points), number, dtype=np.float64)
                nothing = np.full(len(points), np.nan)
                columns = {name: table.get(name, nothing)[good] for name in names}
                yield StreamChunk(points[good], columns, len(points))

    def late_warnings() -> tuple[str, ...]:
        coarse = next(filter(None, (scan.warnings() for scan in precisions)), ())
        if not invalid:
            return coarse
        return (*coarse, f"{invalid:,} points that the scanner marked invalid were left out.")

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

    def warnings(self) -> tuple[str, ...]:
        return tell_precision(self._single, self._top)


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
    path: Path, image: Any, header: Any, number: int, precision: _Precision
) -> Iterator[tuple[Float64, dict[str, AnyArray]]]:
    """Yield (points with the pose applied, every other field) of one scan."""
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
    # (2) Chunks. Invariant: `first` points of the scan are read.
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
        table = {name: chunk[name][:got].copy() for name in fields}
        # (3) Cartesian; precision is judged before the pose moves the scan among the others.
        points = np.stack([table.pop(name) for name in shape], axis=1)
        if shape is _SPHERICAL:
            points = _from_spherical(points)
        precision.look(points)
        if header.has_pose():
            points = points @ np.asarray(header.rotation_matrix).T + np.asarray(header.translation)
        yield points, table
        first += got
    reader.close()


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


def _brief(error: BaseException) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__
