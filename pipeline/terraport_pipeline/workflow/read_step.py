"""The first step of every build: which files, do they fit together, and their points on disk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.engines.readers.survey_stream import FileHead
from terraport_pipeline.model import Crs
from terraport_pipeline.progress import Progress
from terraport_pipeline.stages import read_streamed
from terraport_pipeline.stages.contract import IN_FOLDER
from terraport_pipeline.survey.one_survey import OUTSIDE
from terraport_pipeline.survey.survey_files import SurveyFile, SurveyFiles
from terraport_pipeline.workflow.runner import Runner, Stage
from terraport_pipeline.workflow.workdir import StageRecord, file_digest
from terraport_store.manifest import InputInfo, SurveyUnits

__all__ = ["crs_of", "input_info", "inputs_of", "look_at_survey", "read_once", "units_of"]

_MOST_LEFT_OUT: Final = 1000
"""Files beside a survey that build.json lists: a folder may hold a hundred thousand photos."""


def look_at_survey(runner: Runner, survey: SurveyFiles) -> tuple[SurveyFiles, tuple[FileHead, ...]]:
    """Read the headers of a survey's files and hash them, before any point is read.

    Of files with an index only those bytes are hashed that hold what may lie within the extent.

    Raises
    ------
    SurveyError, ReadError
        As :meth:`~terraport_pipeline.survey.survey_files.SurveyFiles.heads`.
    """
    survey, heads = survey.heads(runner.progress)
    head_of = {file.path: head for file, head in zip(survey.files, heads, strict=True)}
    survey = _hashed(survey, head_of, runner.progress)
    return survey, tuple(head_of[file.path] for file in survey.files)


def read_once(
    runner: Runner, survey: SurveyFiles, *, max_points: int | None, bounded: bool
) -> StageRecord:
    """Read a survey to columns on disk, or take them up.

    Parameters
    ----------
    runner : Runner
        Gets the report.
    survey : SurveyFiles
        Hashed.
    max_points : int or None
        Thin to this many points.
    bounded : bool
        Refuse files that can only be read whole.
    """
    options: dict[str, Any] = {
        "max_points": max_points,
        "skip_damaged": survey.skip_damaged,
        "damaged": [list(pair) for pair in survey.damaged],
    }
    if survey.statement.recorded:
        options["statement"] = survey.statement.recorded
    if survey.extent is not None:
        options["extent"] = [*survey.extent.values]
        options["crs_outside"] = None if survey.crs_outside is None else survey.crs_outside.srs
    return runner.run(
        Stage(
            read_streamed.NAME,
            read_streamed,
            lambda context: read_streamed.run(
                survey, context.folder, context, max_points=max_points, bounded=bounded
            ),
            IN_FOLDER,
            options,
            {"files": survey.key},
        )
    ).record


def crs_of(read: StageRecord) -> Crs | None:
    """Coordinate reference system of a survey as read; None where it states none."""
    crs = read.values["crs"]
    return Crs(**crs) if crs else None


def units_of(read: StageRecord) -> SurveyUnits | None:
    """Units and axes of the input files; None if they are metres east, north and up."""
    units = read.values.get("units")
    return None if units is None else SurveyUnits(**units)


def input_info(record: StageRecord) -> InputInfo:
    """Say in the manifest which points a scene was built from, whatever files they came in.

    The files stand in ``build.json``: in the manifest they would give one survey two versions.
    """
    return InputInfo(name="survey", bytes=sum(record.files.values()), xxh3=record.digest[:16])


def inputs_of(survey: SurveyFiles, record: StageRecord) -> dict[str, Any]:
    """List for ``build.json`` the files that a scene was built from, and those that it was not.

    Returns
    -------
    dict
        ``inputs``: name, format, bytes, xxh3, points (in the file) and repeats (of these, how many
        a file before it has too, in every value; they were taken once). ``left_out``: name,
        reason, damaged. With an extent, every input has ``outside`` (points), xxh3 is that of the
        bytes that were read, and ``extent`` says ``values``, ``points`` and ``files`` outside, and
        ``remarks``.
    """
    notes = record.facts.notes
    read = {file["xxh3"]: file for file in notes["files"]}
    outside = [*survey.outside, *((name, points) for name, points in notes["outside"])]
    damaged = [*survey.damaged, *((name, reason) for name, reason in notes["damaged"])]
    ignored = [
        *survey.ignored,
        *((name, "has no points") for name in notes["empty"]),
        *((name, OUTSIDE) for name, _ in outside),
    ]
    if len(ignored) > _MOST_LEFT_OUT:
        more = f"{len(ignored) - _MOST_LEFT_OUT:,} more files"
        ignored = [*ignored[:_MOST_LEFT_OUT], (more, "not listed")]
    extent = survey.extent
    return {
        "inputs": [
            {
                "name": file.name,
                "format": file.format,
                "bytes": file.bytes,
                "xxh3": file.xxh3,
                "points": read[file.xxh3]["points"],
                "repeats": read[file.xxh3]["repeats"],
                **({} if extent is None else {"outside": read[file.xxh3]["outside"]}),
            }
            for file in survey.files
            if file.xxh3 in read
        ],
        "left_out": [
            *({"name": n, "reason": reason, "damaged": True} for n, reason in damaged),
            *({"name": n, "reason": reason, "damaged": False} for n, reason in ignored),
        ],
        "extent": None if extent is None else {
            "values": [*extent.values],
            "points": sum(f["outside"] for f in notes["files"]) + sum(n for _, n in outside),
            "files": len(outside),
            "remarks": list(notes["remarks"]),
        },
    }  # fmt: skip


def _hashed(
    survey: SurveyFiles, head_of: Mapping[Path, FileHead], progress: Progress
) -> SurveyFiles:
    """Compute the hash of what is read of every file; of files with the same one the first stays.

    Where an index leaves out points their bytes do not count, or a hundredth of a large file would
    cost reading all of it.
    """
    ranges_of = {file.path: head_of[file.path].ranges for file in survey.files}
    total = sum(
        file.bytes if ranges is None else sum(end - begin for begin, end in ranges)
        for file, ranges in zip(survey.files, ranges_of.values(), strict=True)
    )
    progress.start("read: checksum", float(total), "bytes")
    unique: dict[tuple[int, str], SurveyFile] = {}
    ignored = list(survey.ignored)
    for file in survey.files:
        xxh3 = file_digest(file.path, progress.advance, ranges_of[file.path])
        first = unique.get((file.bytes, xxh3))
        if first is None:
            unique[file.bytes, xxh3] = replace(file, xxh3=xxh3)
        else:
            what = "bytes" if ranges_of[file.path] is None else "bytes within the extent"
            ignored.append((file.name, f"has the same {what} as {first.name}"))
    progress.done({} if len(survey.files) == 1 else {"files": len(unique)})
    return replace(survey, files=tuple(unique.values()), ignored=tuple(ignored))
