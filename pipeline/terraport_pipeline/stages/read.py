"""Read a survey of any supported format into one value.

The content decides the format, the file name only where the content cannot (text). What follows
reading is the same for all: points without finite coordinates are dropped and counted, coordinates
are brought to metres, and traps that ruin a scene (degrees, 32-bit coordinates, no colour) are
refused or named.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines.readers.raw_survey import Advance, RawSurvey, check_precision
from terraport_pipeline.engines.readers.read_e57 import read_e57
from terraport_pipeline.engines.readers.read_las import read_las
from terraport_pipeline.engines.readers.read_pcd import read_pcd
from terraport_pipeline.engines.readers.read_ply import read_ply
from terraport_pipeline.engines.readers.read_xyz import read_xyz
from terraport_pipeline.engines.readers.survey_crs import to_metres
from terraport_pipeline.errors import OptionError, ReadError
from terraport_pipeline.model import Survey
from terraport_pipeline.progress import NullProgress, Progress

__all__ = ["FORMATS", "MAX_SPAN_M", "NAME", "find_format", "read_survey"]

NAME: Final = "read"

FORMATS: Final[dict[str, tuple[str, ...]]] = {
    "las": (".las", ".laz"),
    "ply": (".ply",),
    "pcd": (".pcd",),
    "e57": (".e57",),
    "xyz": (".xyz", ".csv", ".txt", ".asc", ".pts", ".xyzrgb", ".dat"),
}
"""Readers and the file name endings that belong to them."""

_READERS: Final = {
    "las": read_las,
    "ply": read_ply,
    "pcd": read_pcd,
    "e57": read_e57,
    "xyz": read_xyz,
}

_MAGIC: Final = {
    "las": (b"LASF",),
    "ply": (b"ply\n", b"ply\r", b"ply "),
    "pcd": (b"# .PCD", b"VERSION .7", b"VERSION 0.7"),
    "e57": (b"ASTM-E57",),
}

_FOREIGN: Final = (
    (b"version https://git-lfs", "a Git LFS pointer", "fetch the file itself: git lfs pull"),
    (b"PK\x03\x04", "a ZIP archive", "unpack it and give the survey in it"),
    (b"\x1f\x8b", "a gzip archive", "unpack it and give the survey in it"),
    (b"<!DOCTYPE", "a web page", "download the file itself"),
    (b"<html", "a web page", "download the file itself"),
)

MAX_SPAN_M: Final = 1e7
"""No survey is wider than a quarter of the Earth: larger spans are damaged coordinates."""


def read_survey(
    path: Path | str, *, progress: Progress | None = None, max_points: int | None = None
) -> Survey:
    """Read a survey.

    Parameters
    ----------
    path : path
        LAS, LAZ, COPC, PLY, PCD, E57, or text (XYZ, CSV, TXT, ASC, PTS).
    progress : Progress, optional
        Told about points read (bytes, for text).
    max_points : int, optional
        Thin the cloud to this many points, evenly along the file and the same ones each time;
        None reads all. At least 1.

    Returns
    -------
    Survey
        Points in metres; every further value per point as an attribute in the file's dtype.
        Surveys in feet are converted to metres (with a warning), and their CRS becomes the same
        projection in metres.

    Raises
    ------
    ReadError
        When the file is missing, empty, of no known format, cut off or damaged, without x, y, z,
        without one finite point, or in degrees.
    OptionError
        When `max_points` is not positive.
    """
    path = Path(path)
    if max_points is not None and max_points < 1:
        raise OptionError(f"max_points is {max_points}, expected at least 1; leave it out for all")
    name = find_format(path)
    report = progress or NullProgress()
    try:
        raw = _READERS[name](
            path, advance=_starting(report, path, in_bytes=name == "xyz"), max_points=max_points
        )
    except OSError as error:
        raise ReadError(path, f"the file cannot be read ({error})", "check the disk") from error
    survey = _finish(path, raw, name)
    report.done({"points": len(survey.points), "attributes": len(survey.attributes)})
    return survey


def find_format(path: Path) -> str:
    """Say which reader a file needs: a key of :data:`FORMATS`.

    Raises
    ------
    ReadError
        When there is no such file, it is empty, or nothing here reads it.
    """
    # (1) Something to read.
    if not path.exists():
        raise ReadError(path, "there is no such file", "check the name")
    if not path.is_file():
        raise ReadError(path, "this is a folder, expected one file", "name the survey in it")
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError as error:
        raise ReadError(path, f"the file cannot be opened ({error})", "check its rights") from error
    if not head:
        raise ReadError(path, "the file is empty (0 bytes)", "copy or export it again")
    # (2) By content: first bytes of the formats, and of files that people give by mistake.
    for name, starts in _MAGIC.items():
        if head.startswith(starts):
            return name
    for start, what, advice in _FOREIGN:
        if head.startswith(start):
            raise ReadError(path, f"this is {what}, no survey", advice)
    if head.lstrip().startswith(b"# .PCD") or b"\nFIELDS" in head[:512]:
        return "pcd"
    # (3) By name, only for text, which has no first bytes of its own.
    suffix = path.suffix.lower()
    if suffix in FORMATS["xyz"]:
        return "xyz"
    for name, suffixes in FORMATS.items():
        if suffix in suffixes:
            raise ReadError(
                path,
                f"the file starts with {head[:8]!r}, expected {_MAGIC[name][0]!r} of a {suffix} "
                "file",
                "it is damaged or has the wrong name: export it again",
                "byte 0",
            )
    readable = ", ".join(ending for endings in FORMATS.values() for ending in endings)
    raise ReadError(
        path,
        f"{suffix or 'a name without ending'} is no known kind of survey (the file starts with "
        f"{head[:8]!r})",
        f"terraport reads {readable}",
    )


def _starting(report: Progress, path: Path, *, in_bytes: bool) -> Advance:
    """Make the reader's progress callback: the first call knows the total and starts the step."""
    started = False

    def advance(count: int, total: int) -> None:
        nonlocal started
        if not started:
            report.start(f"read {path.name}", total, "bytes" if in_bytes else "points")
            started = True
        report.advance(count)

    return advance


def _finish(path: Path, raw: RawSurvey, name: str) -> Survey:
    # (1) Drop points without a place.
    warnings = list(raw.warnings)
    points, colours, attributes = raw.points, raw.colours, raw.attributes
    finite = np.isfinite(points).all(axis=1)
    lost = len(points) - int(np.count_nonzero(finite))
    if lost == len(points):
        raise ReadError(
            path,
            f"not one of {lost:,} points has finite coordinates",
            "export the survey again",
        )
    if lost:
        warnings.append(f"{lost:,} of {len(points):,} points have no finite coordinates: dropped.")
        points = points[finite]
        colours = None if colours is None else colours[finite]
        attributes = {key: values[finite] for key, values in attributes.items()}
    # (2) Damaged or coarse coordinates, then metres.
    span = float(np.ptp(points, axis=0).max())
    if span > MAX_SPAN_M:
        raise ReadError(
            path,
            f"the coordinates span {span:.3g}, expected less than {MAX_SPAN_M:.0e} metres",
            "some are damaged: remove them or export the survey again",
        )
    if name not in ("las", "e57"):  # LAS has a stated step; the E57 reader looks at each scan
        warnings += check_precision(points)
    points, crs, notes = to_metres(path, points, raw.crs)
    warnings += notes
    if colours is None:
        warnings.append("The survey has no colour (RGB): what no photo shows will be grey.")
    return Survey(points, colours, attributes, crs, name, tuple(warnings))
