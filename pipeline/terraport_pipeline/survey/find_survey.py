"""What a user gives (files, folders, patterns), searched for the files of one survey."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from terraport_pipeline.engines.odm_project import find_odm_project
from terraport_pipeline.engines.readers.read_ply import has_faces
from terraport_pipeline.engines.readers.survey_format import (
    FORMATS,
    find_format,
    require_reader,
)
from terraport_pipeline.engines.readers.text_form import is_table
from terraport_pipeline.errors import OptionError, ReadError, SurveyError
from terraport_pipeline.extent import Extent
from terraport_pipeline.survey.inputs import expand_input, natural_order
from terraport_pipeline.survey.one_survey import listed
from terraport_pipeline.survey.survey_files import TEXT, SurveyFile, SurveyFiles, prj_beside
from terraport_pipeline.survey_statement import SurveyStatement

__all__ = ["MAX_FILES", "find_survey"]

MAX_FILES: Final = 10_000
"""Files of one survey."""

_MAX_ENTRIES: Final = 1_000_000
"""Entries of a folder that are looked at, folders within it included."""

_UNSURE_TEXT: Final = frozenset({".txt", ".csv", ".dat"})
"""Endings of text that is as often something else."""

_SCENE: Final = "scene.json"


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
    MissingReaderError
        A file's kind is read by an extra that is not installed.
    OptionError
        Columns are stated, and no file is a text.
    """
    inputs = [inputs] if isinstance(inputs, Path) else list(inputs)
    found: list[SurveyFile] = []
    ignored: list[tuple[str, str]] = []
    # (1) What was named: files as they are, folders searched, patterns expanded. Of several files
    # those whose kind cannot be told are kept without one: all damage is told together, later.
    paths = [path for given in inputs for path in expand_input(given)]
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
        found.append(SurveyFile(path, path.name, kind, _size(path), prj=prj_beside(path)))
    # (2) Each file once, by its own name rather than a link's; in natural order.
    unique: dict[object, SurveyFile] = {}
    for file in sorted(found, key=lambda file: (file.path.is_symlink(), natural_order(file.name))):
        first = unique.setdefault(_identity(file.path), file)
        if first is not file:
            ignored.append((file.name, f"is the same file as {first.name}"))
    files = tuple(sorted(unique.values(), key=lambda file: natural_order(file.name)))
    if len(files) > MAX_FILES:
        raise SurveyError(
            f"{len(files):,} files; a survey has at most {MAX_FILES:,}: merge some of them first"
        )
    if not files:
        raise _nothing_found(inputs, ignored)
    for file in files:
        require_reader(file.path, file.format)
    # (3) Its name for people.
    [given, *more] = inputs
    title = f"{len(files)} files"
    if len(files) == 1:
        title = files[0].name
    elif not more and given.is_dir():
        title = given.resolve().name or str(given)
    statement = statement or SurveyStatement()
    if statement.columns is not None and not any(file.format == TEXT for file in files):
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
            if path.suffix.lower() in FORMATS[TEXT]:
                ignored.append((name, error.reason))
                continue
            kind = ""  # damaged, or a link to nothing: told with the others when headers are read
        file = SurveyFile(path, name, kind, _size(path), prj=prj_beside(path))
        if kind == TEXT:
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
