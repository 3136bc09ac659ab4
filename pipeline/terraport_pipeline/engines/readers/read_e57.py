"""E57 (ASTM E2807) by pye57's libe57: every scan, with its pose applied.

All fields of all scans are kept; a field that only some scans have is NaN in the others. With more
than one scan, the attribute ``scan`` says which one a point belongs to. Points marked invalid by
the scanner are left out, and values marked invalid are NaN. The pose turns normals as it turns
points.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from pye57 import ScanHeader, libe57
from pyproj import CRS
from pyproj.exceptions import CRSError
from scipy.spatial.transform import Rotation

from terraport_payload.types import AnyArray, Bool, Float64
from terraport_pipeline.engines.readers.survey_chunk import StreamChunk, tell_precision
from terraport_pipeline.errors import ReadError

__all__ = ["E57Stream", "open_e57"]

_CHUNK_POINTS: Final = 500_000

_CARTESIAN: Final = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL: Final = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_INVALID: Final = ("cartesianInvalidState", "sphericalInvalidState")
_COLOURS: Final = ("colorRed", "colorGreen", "colorBlue")
_INVALID_VALUES: Final = {
    "isColorInvalid": _COLOURS,
    "isIntensityInvalid": ("intensity",),
    "isTimeStampInvalid": ("timeStamp",),
}
"""Fields that mark invalid values, with the fields whose values they mark."""

_NORMAL: Final = "normalX"
"""Suffix of the field name of a normal's first component; an extension's prefix precedes it."""

_ZERO_LENGTH: Final = 1e-6
_UNIT_ERROR: Final = 1e-3
"""Length below which a quaternion states no rotation, and difference of its length from 1 that
gives a warning."""

_MOST_INTENSITY_RATIO: Final = 4.0
"""Largest ratio of two scans' intensity ranges; above it they are in different units."""

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
    colour_limits: dict[int, tuple[float, float]]
    """Smallest and largest colour value that the file states, by scan."""
    scans: int
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
    scans = [
        (n, header) for n, (header, count) in enumerate(zip(headers, counts, strict=True)) if count
    ]
    poses = {number: _pose(path, header, number) for number, header in scans}
    left_out = {*_INVALID, *_INVALID_VALUES}
    fields = [
        [
            *(
                n
                for n in header.point_fields
                if n not in {*_shape(path, header, number), *left_out}
            ),
            *(["scan"] if len(headers) > 1 else []),
        ]
        for number, header in scans
    ]
    names = list(dict.fromkeys(name for scan in fields for name in scan))
    partial = [name for name in names if any(name not in scan for scan in fields)]
    precisions: list[_Precision] = []
    invalid: Counter[str] = Counter()

    # (2) Scan after scan; points that the scanner marked invalid are counted, not handed out.
    def chunks() -> Iterator[StreamChunk]:
        for number, header in scans:
            precisions.append(precision := _Precision())
            for points, table in _scan_parts(path, image, header, number, poses[number], precision):
                good = _valid_points(table, _shape(path, header, number), len(points))
                invalid["points"] += int(np.count_nonzero(~good))
                for flag, marked in _INVALID_VALUES.items():
                    bad = table.pop(flag, np.zeros(len(points))) != 0
                    present = [name for name in marked if name in table]
                    for name in present:
                        table[name][bad] = np.nan
                    invalid[", ".join(marked)] += int(np.count_nonzero(bad & good)) * bool(present)
                table["scan"] = np.full(len(points), number, dtype=np.float64)
                nothing = np.full(len(points), np.nan)
                columns = {name: table.get(name, nothing)[good] for name in names}
                yield StreamChunk(points[good], columns, len(points), scan=number)

    def late_warnings() -> tuple[str, ...]:
        texts = next(filter(None, (scan.warnings() for scan in precisions)), ())
        if invalid["points"]:
            texts += (
                f"{invalid['points']:,} points that the scanner marked invalid were left out.",
            )
        for name in ("intensity", "timeStamp"):  # the survey as a whole warns about colours
            if invalid[name]:
                texts += (
                    f"{invalid[name]:,} values of {name} are marked invalid: no value there.",
                )
        return texts

    # (3) What is worth saying before a point is read.
    has_colour = all(name in names for name in _COLOURS)
    warnings = tuple(text for _, _, texts in poses.values() for text in texts)
    grey = [
        str(number)
        for (number, _), scan in zip(scans, fields, strict=True)
        if not all(name in scan for name in _COLOURS)
    ]
    if has_colour and grey:
        warnings += (f"There is no colour in scan {', '.join(grey)}: its points are grey.",)
    partial = [name for name in partial if not (has_colour and name in _COLOURS)]
    if partial:
        warnings += (f"Not every scan has {', '.join(partial)}; it is NaN in the others.",)
    crs, notes = _find_crs(root)
    return E57Stream(
        total,
        crs,
        warnings + notes + _intensity_warnings(scans),
        late_warnings,
        _COLOURS if has_colour else (),
        {n: limits for n, header in scans if (limits := _colour_limits(header)) is not None},
        len(headers),
        chunks,
    )


def _valid_points(table: dict[str, AnyArray], shape: tuple[str, ...], count: int) -> Bool:
    """Remove the columns that mark invalid points, and return a mask of the valid points."""
    states = [table.pop(name, None) for name in _INVALID]
    if shape is _SPHERICAL:
        states.reverse()
    state = next((state for state in states if state is not None), np.zeros(count))
    valid: Bool = state == 0
    return valid


def _pose(path: Path, header: Any, number: int) -> tuple[Float64 | None, Float64, list[str]]:
    """Read a scan's rotation as a matrix (None without one), its translation, and warnings."""
    rotation, translation = None, np.zeros(3)
    warnings: list[str] = []
    if not header.has_pose():
        return rotation, translation, warnings
    pose = header.node["pose"]
    if pose.isDefined("translation"):
        translation = _components(path, pose["translation"], "xyz", number)
    if pose.isDefined("rotation"):
        quaternion = _components(path, pose["rotation"], "wxyz", number)
        length = float(np.linalg.norm(quaternion))
        written = " ".join(f"{value:g}" for value in quaternion)
        if length < _ZERO_LENGTH:
            warnings.append(
                f"The pose of scan {number} has the quaternion {written}, which is not a rotation: "
                "only its translation is applied."
            )
        else:
            rotation = Rotation.from_quat(np.roll(quaternion, -1)).as_matrix()
            if abs(length - 1.0) > _UNIT_ERROR:
                warnings.append(
                    f"The pose of scan {number} states the quaternion {written} of length "
                    f"{length:g}, expected 1: it is scaled to that."
                )
    return rotation, translation, warnings


def _components(path: Path, node: Any, names: str, number: int) -> Float64:
    """Read the numbers of a structure by name, in any order."""
    values = np.array(
        [float(_value(node[name])) if node.isDefined(name) else np.nan for name in names]
    )
    if not np.isfinite(values).all():
        raise ReadError(
            path,
            f"the pose of scan {number} has {' '.join(f'{value:g}' for value in values)} for "
            f"{' '.join(names)}, expected numbers",
            "register and export the survey again",
        )
    return values


def _value(node: Any) -> float:
    """Return a number of the header, whatever type it is stored in."""
    return float(node.scaledValue() if hasattr(node, "scaledValue") else node.value())


def _limits(header: Any, name: str, fields: Sequence[str]) -> list[tuple[float, float]]:
    """Read the stated smallest and largest values of fields; None if they are not all plausible."""
    node = header.node[name] if header.node.isDefined(name) else None
    pairs = []
    for field in fields:
        ends = [f"{field}{end}" for end in ("Minimum", "Maximum")]
        if node is None or not all(node.isDefined(end) for end in ends):
            return []
        low, high = (_value(node[end]) for end in ends)
        if not (np.isfinite([low, high]).all() and low < high):
            return []
        pairs.append((low, high))
    return pairs


def _colour_limits(header: Any) -> tuple[float, float] | None:
    """Read the range of a scan's colours.

    None if the channels have different ranges: these are then ranges of the actual values, which do
    not tell the depth.
    """
    pairs = set(_limits(header, "colorLimits", _COLOURS))
    return pairs.pop() if len(pairs) == 1 else None


def _intensity_warnings(scans: Sequence[tuple[int, Any]]) -> tuple[str, ...]:
    """Warn about scans whose stated intensity ranges show that they cannot be compared."""
    stated = {
        number: pairs[0]
        for number, header in scans
        if (pairs := _limits(header, "intensityLimits", ["intensity"]))
    }
    if len(stated) < 2:
        return ()
    least, most = (pick(stated, key=lambda n: stated[n][1] - stated[n][0]) for pick in (min, max))
    spans = [stated[n][1] - stated[n][0] for n in (least, most)]
    if spans[1] <= _MOST_INTENSITY_RATIO * spans[0]:
        return ()
    each = " and ".join(
        f"{stated[n][0]:g} to {stated[n][1]:g} in scan {n}" for n in sorted((least, most))
    )
    warning = (
        f"The scans state intensities of different ranges ({each}): they are kept as they are, and "
        "cannot be compared between scans."
    )
    return (warning,)


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
    path: Path,
    image: Any,
    header: Any,
    number: int,
    pose: tuple[Float64 | None, Float64, list[str]],
    precision: _Precision,
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
        rotation, translation, _ = pose
        if rotation is not None:
            points = points @ rotation.T
            for components in _normals(fields):
                turned = np.stack([table[name] for name in components], axis=1) @ rotation.T
                table.update(zip(components, turned.T, strict=True))
        yield points + translation, table
        first += got
    reader.close()


def _normals(fields: Sequence[str]) -> list[list[str]]:
    """Find the fields that hold the components of normals: ``nor:normalX`` and so on."""
    stems = [name.removesuffix("X") for name in fields if name.endswith(_NORMAL)]
    triples = [[stem + axis for axis in "XYZ"] for stem in stems]
    return [triple for triple in triples if all(name in fields for name in triple)]


def _from_spherical(values: Float64) -> Float64:
    """Convert (range, azimuth, elevation), ASTM E2807 8.3.2, to x, y, z."""
    distance, azimuth, elevation = values.T
    flat = distance * np.cos(elevation)
    return np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), distance * np.sin(elevation)], axis=1
    )


def _find_crs(root: Any) -> tuple[Any | None, tuple[str, ...]]:
    """Read the CRS from coordinateMetadata, which the standard leaves as free text (WKT mostly)."""
    if not root.isDefined("coordinateMetadata"):
        return None, ()
    text = str(root["coordinateMetadata"].value()).strip()
    try:
        return CRS.from_user_input(text) if text else None, ()
    except CRSError as error:
        note = (
            f"The file's coordinate reference system cannot be understood ({_brief(error)}); the "
            "survey is treated as one without."
        )
        return None, (note,)


def _brief(error: BaseException) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__
