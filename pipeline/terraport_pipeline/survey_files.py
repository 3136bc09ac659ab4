"""The files of a survey: one, several, or a delivery in a folder, found and told apart.

What a user gives (files, folders, patterns) becomes one value that every reader takes. Their order
is natural (``tile_2`` before ``tile_10``) and only matters to the eye: points are put into an order
of their own when they are read.
"""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import xxhash
from pyproj import CRS
from pyproj.exceptions import CRSError

from terraport_pipeline.engines.odm_project import find_odm_project
from terraport_pipeline.engines.readers.read_ply import has_faces
from terraport_pipeline.engines.readers.read_xyz import is_table
from terraport_pipeline.engines.readers.survey_crs import metre_factors
from terraport_pipeline.engines.readers.survey_format import FORMATS, find_format
from terraport_pipeline.engines.readers.survey_stream import FileHead, read_head
from terraport_pipeline.errors import NoPointsError, OptionError, ReadError, SurveyError
from terraport_pipeline.extent import Extent
from terraport_pipeline.progress import Progress
from terraport_pipeline.survey_statement import SurveyStatement
from terraport_store import meant_url

__all__ = [
    "FAR",
    "MAX_FILES",
    "OUTSIDE",
    "SurveyFile",
    "SurveyFiles",
    "damage_of",
    "find_survey",
    "listed",
    "meaning_of",
    "nothing_within",
    "one_crs",
    "refuse_far",
]

MAX_FILES: Final = 10_000
"""Files of one survey."""

OUTSIDE: Final = "lies outside the extent"
"""Why a file is not read, or nothing of it is taken."""

_MAX_ENTRIES: Final = 1_000_000
"""Entries of a folder that are looked at, folders within it included."""

_MAX_PRJ_LENGTH: Final = 100_000
"""Characters of a ``.prj`` that are read; a usual one has 500."""

_LISTED: Final = 3
"""Names in a message; of the others the number."""

_TEXT: Final = "xyz"

_UNSURE_TEXT: Final = frozenset({".txt", ".csv", ".dat"})
"""Endings of text that is as often something else."""

_SCENE: Final = "scene.json"

FAR: Final = 100_000.0
"""Files of one survey lie nearer to each other than this, in metres or the CRS's unit."""


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
        file = SurveyFile(path, path.name, kind, size, prj=_prj_beside(path))
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
        in_other_crs = _in_other_crs(heads)
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
        crs = one_crs([(file.name, heads[file].crs) for file in kept], advice)
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


def find_survey(
    inputs: Sequence[Path] | Path,
    *,
    skip_damaged: bool = False,
    extent: Extent | None = None,
    statement: SurveyStatement | None = None,
) -> SurveyFiles:
    """Find the files of a survey.

    Parameters
    ----------
    inputs : path or sequence of paths
        Files, folders (searched with the folders in them; of a project of OpenDroneMap its
        georeferenced cloud alone) and patterns (``tiles/*.laz``; ``**`` for any folders). A file
        that is named is taken whatever its ending; in a folder what is no survey is left alone and
        listed; hidden files are passed over.
    skip_damaged : bool
        Leave out damaged files when they are found, and say so; of files in several coordinate
        reference systems those that are not in the one of more than half.
    extent : Extent, optional
        Take only the points within it, in the files' own coordinates.
    statement : SurveyStatement, optional
        What the user says of CRS, units and columns.

    Returns
    -------
    SurveyFiles
        Without hashes. Each file once, also where links lead to it twice.

    Raises
    ------
    SurveyError
        There is no such file, no file matches, a folder holds no survey, or there are too many.
    ReadError
        A file that was named is no survey.
    OptionError
        Columns are stated, and no file is a text.
    """
    inputs = [inputs] if isinstance(inputs, Path) else list(inputs)
    found: list[SurveyFile] = []
    ignored: list[tuple[str, str]] = []
    # (1) What was named: files as they are, folders searched, patterns expanded. Of several files
    # those whose kind cannot be told are kept without one: all damage is told together, later.
    paths = [path for given in inputs for path in _expanded(given)]
    alone = len(paths) == 1
    for path in paths:
        project = find_odm_project(path)
        if project is not None and project.cloud is not None:
            path = project.cloud
            ignored.append(("other files", f"an OpenDroneMap project is its {path.name}"))
        if path.is_dir():
            _search(path, "" if alone else f"{path.resolve().name}/", found, ignored)
            continue
        try:
            kind = find_format(path)
        except ReadError:
            if alone:
                raise
            kind = ""
        found.append(SurveyFile(path, path.name, kind, _size(path), prj=_prj_beside(path)))
    # (2) Each file once, by its own name rather than a link's; in natural order.
    unique: dict[object, SurveyFile] = {}
    for file in sorted(found, key=lambda file: (file.path.is_symlink(), _natural(file.name))):
        first = unique.setdefault(_identity(file.path), file)
        if first is not file:
            ignored.append((file.name, f"is the same file as {first.name}"))
    files = tuple(sorted(unique.values(), key=lambda file: _natural(file.name)))
    if len(files) > MAX_FILES:
        raise SurveyError(
            f"{len(files):,} files; a survey has at most {MAX_FILES:,}: merge some of them first"
        )
    if not files:
        raise _nothing_found(inputs, ignored)
    # (3) Its name for people.
    [given, *more] = inputs
    title = f"{len(files)} files"
    if len(files) == 1:
        title = files[0].name
    elif not more and given.is_dir():
        title = given.resolve().name or str(given)
    statement = statement or SurveyStatement()
    if statement.columns is not None and not any(file.format == _TEXT for file in files):
        raise OptionError(
            f"columns {','.join(statement.columns)}, of {title}; expected a text (XYZ, CSV, TXT): "
            "other formats name their columns themselves"
        )
    return SurveyFiles(
        title,
        files,
        tuple(ignored),
        skip_damaged=skip_damaged,
        extent=extent,
        statement=statement,
    )


def one_crs(files: Sequence[tuple[str, Any | None]], advice: str = "") -> Any | None:
    """Find the coordinate reference system that all files which state one agree on.

    Parameters
    ----------
    files : sequence of (str, pyproj.CRS or None)
        Name of every file, and what it states.
    advice : str
        What else can be done where they differ.

    Returns
    -------
    pyproj.CRS or None
        None where no file states one.

    Raises
    ------
    SurveyError
        Two state different ones; names the files of each.
    """
    groups: list[tuple[Any, list[str]]] = []
    known: dict[str, list[str]] = {}  # the comparison of two systems is slow, that of texts is not
    for name, crs in files:
        if crs is None:
            continue
        text = crs.srs
        if text not in known:
            group = next((names for other, names in groups if other == crs), None)
            if group is None:
                group = []
                groups.append((crs, group))
            known[text] = group
        known[text].append(name)
    if len(groups) > 1:
        stated = "; ".join(f"{crs.name} in {listed(names)}" for crs, names in groups)
        raise SurveyError(
            f"the files are in {len(groups)} coordinate reference systems ({stated}); expected "
            f"one: reproject some (PDAL filters.reprojection, las2las), or build them apart{advice}"
        )
    return groups[0][0] if groups else None


def nothing_within(
    title: str,
    extent: Extent,
    boxes: Sequence[tuple[Sequence[float] | None, Sequence[float] | None]],
    crs: Any | None,
) -> SurveyError:
    """Say that a survey has no point within an extent, and where its points are.

    Parameters
    ----------
    title : str
        Of the survey.
    extent : Extent
    boxes : sequence of (low, high)
        Corners of each file, None where they are not known.
    crs : pyproj.CRS or None
        Of the survey.
    """
    stated = [(low, high) for low, high in boxes if low is not None and high is not None]
    where = "its bounds are not known"
    if stated:
        lows, highs = zip(*stated, strict=True)
        (xmin, ymin), (xmax, ymax) = (
            tuple(pick(corner[axis] for corner in corners) for axis in (0, 1))
            for pick, corners in ((min, lows), (max, highs))
        )
        where = f"it spans {xmin:.15g} {ymin:.15g} {xmax:.15g} {ymax:.15g}"
    system = "its own coordinates" if crs is None else crs.name
    return SurveyError(
        f"{title} has no point within extent {extent}: {where} ({system}); expected XMIN YMIN XMAX "
        "YMAX in the coordinates of the files"
    )


def _in_other_crs(heads: Mapping[SurveyFile, FileHead]) -> list[tuple[SurveyFile, str]]:
    """Find files in another CRS than most, and say so; none where no CRS is that of over half."""
    by_text: dict[str, list[SurveyFile]] = {}  # comparing two systems is slow, texts is not
    stated: dict[str, Any] = {}
    for file, head in heads.items():
        if head.crs is not None:
            by_text.setdefault(head.crs.srs, []).append(file)
            stated[head.crs.srs] = head.crs
    if len(stated) < 2:
        return []
    count = sum(map(len, by_text.values()))
    usual = stated[max(by_text, key=lambda text: len(by_text[text]))]
    others = {text: crs for text, crs in stated.items() if crs != usual}
    if 2 * sum(len(by_text[text]) for text in others) >= count:
        return []
    return [
        (file, f"it is in {crs.name}, most others in {usual.name}")
        for text, crs in others.items()
        for file in by_text[text]
    ]


def listed(names: Sequence[str]) -> str:
    """Join names for a message: the first few, and how many more.

    Examples
    --------
    >>> listed(["a", "b", "c", "d", "e"])
    'a, b, c and 2 more'
    """
    if len(names) <= _LISTED + 1:
        return ", ".join(names)
    return f"{', '.join(names[:_LISTED])} and {len(names) - _LISTED} more"


def damage_of(errors: Sequence[ReadError], count: int) -> ReadError | SurveyError:
    """Say of a survey in several files which of them are damaged, and how to go on without."""
    if len(errors) == 1:
        error = errors[0]
        advice = f"{error.advice}, or go on without the file: --skip-damaged"
        return ReadError(error.path, error.reason, advice, error.location)
    each = "\n  ".join(str(error) for error in errors)
    return SurveyError(
        f"{len(errors)} of {count} files cannot be read; --skip-damaged goes on without them:\n"
        f"  {each}"
    )


def _expanded(given: Path) -> list[Path]:
    """Expand a pattern, unless there is a file of that very name."""
    if given.exists():
        return [given]
    url = meant_url(given)
    if url is not None:
        raise SurveyError(
            f"{url} is an address; surveys are read from this machine: fetch it first"
        )
    anchor = given
    while re.search(r"[*?\[]", str(anchor)):
        anchor = anchor.parent
    if anchor == given:
        raise SurveyError(f"no file {given}")
    paths = list(anchor.glob(str(given.relative_to(anchor))))
    if not paths:
        raise SurveyError(f"no file matches {given}; check the folder and the ending")
    return sorted(paths, key=lambda path: _natural(str(path)))


def _search(
    folder: Path, prefix: str, found: list[SurveyFile], ignored: list[tuple[str, str]]
) -> None:
    """Take the surveys out of a folder and those in it, and list what is none."""
    # (1) By kind: binary formats by their first bytes, text apart.
    text: list[SurveyFile] = []
    sidecars: list[tuple[Path, str]] = []
    binary = 0
    for path in _walk(folder):
        name = prefix + path.relative_to(folder).as_posix()
        if path.suffix.lower() not in _ENDINGS:
            if path.suffix.lower() == ".prj":
                sidecars.append((path, name))
            else:
                ignored.append((name, "is no survey"))
            continue
        try:
            kind = find_format(path)
        except ReadError as error:
            if path.suffix.lower() in FORMATS[_TEXT]:
                ignored.append((name, error.reason))
                continue
            kind = ""  # damaged, or a link to nothing: told with the others when headers are read
        file = SurveyFile(path, name, kind, _size(path), prj=_prj_beside(path))
        if kind == _TEXT:
            text.append(file)
        elif kind == "ply" and has_faces(path):
            ignored.append((name, "is a mesh; name it to read its vertices"))
        else:
            found.append(file)
            binary += 1
    # (2) A text beside LAZ is a list or a note far more often than a survey; alone it is one, if
    # it is a table of numbers.
    for file in text:
        if binary:
            ignored.append((file.name, "is text beside a survey; name it to read it as points"))
        elif file.path.suffix.lower() in _UNSURE_TEXT and not is_table(file.path):
            ignored.append((file.name, "is no table of points"))
        else:
            found.append(file)
    # (3) What states the CRS of a survey beside it is read with that.
    stems = {file.path.with_suffix("") for file in found if file.prj}
    reason = "states no CRS of a survey beside it"
    ignored += [(name, reason) for path, name in sidecars if path.with_suffix("") not in stems]


_ENDINGS: Final = frozenset(ending for endings in FORMATS.values() for ending in endings)


def _walk(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder and of those in it, hidden ones left out, each folder once."""
    seen: set[tuple[int, int]] = set()
    entries = 0
    for root, folders, names in os.walk(folder, followlinks=True):
        stat = Path(root).stat()
        if (stat.st_dev, stat.st_ino) in seen:  # a link that leads back
            folders.clear()
            continue
        seen.add((stat.st_dev, stat.st_ino))
        if _SCENE in names:  # a scene of ours beside the survey
            folders.clear()
            continue
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        entries += len(names) + len(folders)
        if entries > _MAX_ENTRIES:
            raise SurveyError(
                f"{folder} holds more than {_MAX_ENTRIES:,} files; give the folder of the survey"
            )
        for name in sorted(names):
            path = Path(root, name)
            if not name.startswith(".") and (path.is_file() or path.is_symlink()):
                yield path


def _identity(path: Path) -> object:
    """Tell files from links to them; a link to nothing is itself."""
    try:
        stat = path.stat()
    except OSError:
        return path
    return stat.st_dev, stat.st_ino


def _prj_beside(path: Path) -> str:
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


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _nothing_found(inputs: Sequence[Path], ignored: list[tuple[str, str]]) -> SurveyError:
    where = ", ".join(map(str, inputs))
    if not ignored:
        return SurveyError(f"{where} is empty; expected a folder with a survey in it")
    readable = ", ".join(ending for endings in FORMATS.values() for ending in endings)
    return SurveyError(
        f"{where} holds no survey, but {listed([name for name, _ in ignored])}; terraport reads "
        f"{readable}"
    )


def meaning_of(
    files: Sequence[SurveyFile],
    heads: Sequence[FileHead],
    crs: Any | None,
    statement: SurveyStatement,
) -> list[str]:
    """Refuse by the headers' boxes what :func:`.metre_factors` refuses when all points are read.

    Returns
    -------
    list of str
        What is doubtful, as whole sentences.

    Raises
    ------
    ReadError
    """
    corners = [(h.low, h.high) for h in heads if h.low is not None and h.high is not None]
    if len(corners) < len(heads):
        return []
    lows, highs = (np.array(corner, np.float64) for corner in zip(*corners, strict=True))
    low, high = lows.min(axis=0), highs.max(axis=0)
    # A box without size is no box; one as wide as a country holds a stray point.
    if not ((high > low)[:2].all() and float((high - low)[:2].max()) < FAR):
        return []
    return metre_factors(files[0].path, low, high, crs, statement)[2]


def _near_each_other(files: Sequence[SurveyFile], heads: Sequence[FileHead]) -> None:
    """Refuse a file whose header puts it far from most others."""
    middles = [
        tuple((a + b) / 2 for a, b in zip(head.low, head.high, strict=True))
        for head in heads
        if head.low is not None and head.high is not None
    ]
    names = [file.name for file, head in zip(files, heads, strict=True) if head.low is not None]
    refuse_far(names, middles)


def refuse_far(names: Sequence[str], middles: Sequence[Sequence[float]]) -> None:
    """Refuse files far from most others.

    Parameters
    ----------
    names : sequence of str
    middles : sequence of (float, float, float)
        Middle of each file's box.

    Raises
    ------
    SurveyError
        Names the files.
    """
    if len(middles) < 2:
        return
    usual = [sorted(axis)[len(middles) // 2] for axis in zip(*middles, strict=True)]
    away = [max(abs(middle[axis] - usual[axis]) for axis in (0, 1)) for middle in middles]
    far = [name for name, distance in zip(names, away, strict=True) if not distance < FAR]
    if far:
        raise SurveyError(
            f"{listed(far)} lies {max(away) / 1000:,.0f} km from the other files; expected one "
            "survey: is it in another coordinate reference system, or in local coordinates?"
        )


def _touching(
    survey: SurveyFiles, heads: Mapping[SurveyFile, FileHead]
) -> tuple[SurveyFiles, tuple[FileHead, ...]]:
    """Leave out files outside the extent, when all were seen to be one survey in one CRS."""
    kept = tuple(file for file in survey.files if heads[file].rows != 0)
    if survey.extent is None or len(kept) == len(survey.files):
        return survey, tuple(heads[file] for file in survey.files)
    outside = [file for file in survey.files if heads[file].rows == 0]
    crs = one_crs([(file.name, heads[file].crs) for file in survey.files])
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


def _natural(name: str) -> list[tuple[int, int, str]]:
    """Key that sorts numbers in names by value.

    Examples
    --------
    >>> sorted(["t10", "t9", "a"], key=_natural)
    ['a', 't9', 't10']
    """
    pieces = re.split(r"([0-9]+)", name)
    return [(0, int(p), "") if i % 2 else (1, 0, p) for i, p in enumerate(pieces)]


def _suffix(file: SurveyFile) -> str:
    """Give the ending of a text, which says how its columns are meant; nothing else has it."""
    return file.path.suffix.lower() if file.format == _TEXT else ""
