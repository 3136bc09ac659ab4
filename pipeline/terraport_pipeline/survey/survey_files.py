"""The files of a survey as one value that every reader takes, and what their headers say together.

Their order is natural (``tile_2`` before ``tile_10``) and only matters to the eye: points are put
into an order of their own when they are read.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import xxhash
from pyproj import CRS
from pyproj.exceptions import CRSError

from terraport_pipeline.engines.readers.survey_crs import interpret_coordinates
from terraport_pipeline.engines.readers.survey_format import find_format
from terraport_pipeline.engines.readers.survey_stream import FileHead, read_head
from terraport_pipeline.errors import NoPointsError, ReadError, SurveyError
from terraport_pipeline.extent import Extent
from terraport_pipeline.progress import Progress
from terraport_pipeline.survey.one_survey import (
    FAR,
    crs_groups,
    damage_of,
    listed,
    nothing_within,
    one_crs,
    refuse_far,
)
from terraport_pipeline.survey_statement import SurveyStatement
from terraport_store import SurveyUnits

__all__ = ["TEXT", "SurveyFile", "SurveyFiles", "meaning_of", "prj_beside"]

_MAX_PRJ_LENGTH: Final = 100_000
"""Characters of a ``.prj`` that are read; a usual one has 500."""

TEXT: Final = "xyz"
"""Format of texts, whose endings say how their columns are meant."""


@dataclass(frozen=True, slots=True)
class SurveyFile:
    """One file of a survey."""

    path: Path
    name: str
    """For people: relative to the folder that was given, else the file's own name."""
    format: str
    """Key of :data:`~terraport_pipeline.engines.readers.survey_format.FORMATS`."""
    bytes: int
    xxh3: str = ""
    """XXH3-64 of its bytes; empty until it was computed."""
    prj: str = ""
    """Text of the ``.prj`` beside it: a CRS as WKT, for files that state none."""

    @property
    def crs_beside(self) -> Any | None:
        """The pyproj.CRS that the ``.prj`` beside it states; None without one."""
        return _crs_of_prj(self.prj) if self.prj else None


@dataclass(frozen=True, slots=True)
class SurveyFiles:
    """Files that are one survey, in natural order, and what was left out."""

    title: str
    """For people: the file's name, the folder's, or ``9 files``."""
    files: tuple[SurveyFile, ...]
    ignored: tuple[tuple[str, str], ...] = ()
    """Name and reason of what is no part of the survey."""
    damaged: tuple[tuple[str, str], ...] = ()
    """Name and reason of files that cannot be read and are left out because that was asked for."""
    skip_damaged: bool = False
    """Leave out what cannot be read, where anything is left."""
    extent: Extent | None = None
    """Only points within it are of the survey."""
    outside: tuple[tuple[str, int], ...] = ()
    """Name and points of files that lie outside the extent by their headers."""
    crs_outside: Any | None = None
    """pyproj.CRS that files outside the extent state, where no other file states one."""
    statement: SurveyStatement = field(default_factory=SurveyStatement)
    """What the user says of it."""

    @classmethod
    def of(cls, path: Path | str | SurveyFiles) -> SurveyFiles:
        """Make the value of a single file; a value stays as it is."""
        if isinstance(path, SurveyFiles):
            return path
        path = Path(path)
        kind, size = find_format(path), path.stat().st_size
        file = SurveyFile(path, path.name, kind, size, prj=prj_beside(path))
        return cls(path.name, (file,))

    @property
    def size_bytes(self) -> int:
        """Bytes of all files together."""
        return sum(file.bytes for file in self.files)

    @property
    def key(self) -> str:
        """What identifies the files' bytes, whatever their names and order."""
        each = sorted(f"{f.bytes}-{f.xxh3}-{_suffix(f)}{f.prj}" for f in self.files)
        return (
            "+".join(each) if len(each) == 1 else xxhash.xxh3_128_hexdigest("+".join(each).encode())
        )

    def heads(
        self, progress: Progress, *, check_meaning: bool = True
    ) -> tuple[SurveyFiles, tuple[FileHead, ...]]:
        """Read every file's header, and refuse what cannot be one survey, before any point is read.

        Parameters
        ----------
        progress : Progress
        check_meaning : bool
            Refuse coordinates that contradict their CRS or unit; without it whoever asks does.

        Returns
        -------
        survey : SurveyFiles
            Without files that say they have no points, without those that lie outside the extent
            and, if asked for, without damaged ones.
        heads : tuple of FileHead
            One for each file that is left.

        Raises
        ------
        ReadError
            A file is damaged.
        SurveyError
            Several are; or the files are in different coordinate reference systems, or far apart;
            or all lie outside the extent.
        """
        # (1) Every header. Of a single file all errors stand as they are.
        alone = len(self.files) == 1
        heads: dict[SurveyFile, FileHead] = {}
        empty: list[tuple[str, str]] = []
        damaged: list[tuple[SurveyFile, ReadError]] = []
        if not alone:
            progress.start("read: headers", float(len(self.files)), "files")
        for file in self.files:
            try:
                head = read_head(file.path, file.format, self.extent)
                heads[file] = head if head.crs else replace(head, crs=file.crs_beside)
            except NoPointsError:
                if alone:
                    raise
                empty.append((file.name, "has no points"))
            except ReadError as error:
                if alone:
                    raise
                damaged.append((file, error))
            if not alone:
                progress.advance(1)
        if not alone:
            points = sum(head.points for head in heads.values())
            left = len(self.ignored) + len(empty) + len(damaged)
            progress.done({"files": len(heads), "points": points, "left out": left})
        # (2) Damage: refused with all names at once, or left out; so is a CRS of its own.
        in_other_crs = [] if self.statement.crs is not None else _in_other_crs(heads)
        if self.skip_damaged:
            for file, reason in in_other_crs:
                del heads[file]
                damaged.append((file, ReadError(file.path, reason, "reproject it")))
        elif damaged:
            raise damage_of([error for _, error in damaged], len(self.files))
        if not heads:
            raise SurveyError(
                f"{self.title}: none of {len(self.files)} files can be used: "
                f"{listed([*(f.name for f, _ in damaged), *(name for name, _ in empty)])}"
            )
        kept = tuple(heads)
        advice = "; --skip-damaged goes on without the fewer" if in_other_crs else ""
        crs = one_crs([(file.name, heads[file].crs) for file in kept], advice, self.statement)
        _near_each_other(kept, [heads[file] for file in kept])
        if check_meaning:
            meaning_of(kept, [heads[file] for file in kept], crs, self.statement)
        survey = replace(
            self,
            files=kept,
            ignored=(*self.ignored, *empty),
            damaged=(*self.damaged, *((f.name, e.reason) for f, e in damaged)),
        )
        return _touching(survey, heads)


def _in_other_crs(heads: Mapping[SurveyFile, FileHead]) -> list[tuple[SurveyFile, str]]:
    """Find files in another CRS than most, and say so; none where no CRS is that of over half."""
    groups = crs_groups((file.name, head.crs) for file, head in heads.items())
    if len(groups) < 2:
        return []
    usual, most = max(groups, key=lambda group: len(group[1]))
    if 2 * len(most) <= sum(len(names) for _, names in groups):
        return []
    other = {name: crs for crs, names in groups if crs is not usual for name in names}
    return [
        (file, f"it is in {other[file.name].name}, most others in {usual.name}")
        for file in heads
        if file.name in other
    ]


def prj_beside(path: Path) -> str:
    """Read the ``.prj`` of a file, if there is one and it states a CRS; else the empty text."""
    for ending in (".prj", ".PRJ"):
        beside = path.with_suffix(ending)
        if beside != path and beside.is_file():
            try:
                with beside.open(encoding="utf-8-sig", errors="replace") as file:
                    text = file.read(_MAX_PRJ_LENGTH).strip()
            except OSError:
                return ""
            return text if _crs_of_prj(text) is not None else ""
    return ""


@functools.lru_cache(maxsize=64)  # tiles of a delivery have the same text
def _crs_of_prj(text: str) -> Any | None:
    try:
        return CRS.from_wkt(text)
    except CRSError:
        return None


def meaning_of(
    files: Sequence[SurveyFile],
    heads: Sequence[FileHead],
    crs: Any | None,
    statement: SurveyStatement,
) -> tuple[SurveyUnits | None, list[str]]:
    """Apply :func:`.interpret_coordinates` to the bounding boxes in the headers.

    Returns
    -------
    units : SurveyUnits or None
        Units and axes of the coordinates; None where they are metres east, north and up, or not
        known yet.
    warnings : list of str
        Doubtful statements, as whole sentences.

    Raises
    ------
    ReadError
    """
    corners = [(h.low, h.high) for h in heads if h.low is not None and h.high is not None]
    if len(corners) < len(heads):
        return None, []
    lows, highs = (np.array(corner, np.float64) for corner in zip(*corners, strict=True))
    low, high = lows.min(axis=0), highs.max(axis=0)
    # A box without size is no box; one as wide as a country holds a stray point.
    if not ((high > low)[:2].all() and float((high - low)[:2].max()) < FAR):
        return None, []
    doubts = [doubt for head in heads for doubt in head.doubts]
    units, _, warnings = interpret_coordinates(files[0].path, low, high, crs, statement, doubts)
    return units, warnings


def _near_each_other(files: Sequence[SurveyFile], heads: Sequence[FileHead]) -> None:
    """Refuse a file whose header puts it far from most others."""
    middles = [
        tuple((a + b) / 2 for a, b in zip(head.low, head.high, strict=True))
        for head in heads
        if head.low is not None and head.high is not None
    ]
    names = [file.name for file, head in zip(files, heads, strict=True) if head.low is not None]
    refuse_far(names, middles)


def _touching(
    survey: SurveyFiles, heads: Mapping[SurveyFile, FileHead]
) -> tuple[SurveyFiles, tuple[FileHead, ...]]:
    """Leave out files outside the extent, when all were seen to be one survey in one CRS."""
    kept = tuple(file for file in survey.files if heads[file].rows != 0)
    if survey.extent is None or len(kept) == len(survey.files):
        return survey, tuple(heads[file] for file in survey.files)
    outside = [file for file in survey.files if heads[file].rows == 0]
    stated = [(file.name, heads[file].crs) for file in survey.files]
    crs = one_crs(stated, statement=survey.statement)
    if not kept:
        boxes = [(heads[file].low, heads[file].high) for file in outside]
        raise nothing_within(survey.title, survey.extent, boxes, crs)
    is_stated = any(heads[file].crs is not None for file in kept)
    survey = replace(
        survey,
        files=kept,
        outside=tuple((file.name, heads[file].points) for file in outside),
        crs_outside=None if is_stated else crs,
    )
    return survey, tuple(heads[file] for file in kept)


def _suffix(file: SurveyFile) -> str:
    """Give the ending of a text, which says how its columns are meant; nothing else has it."""
    return file.path.suffix.lower() if file.format == TEXT else ""
