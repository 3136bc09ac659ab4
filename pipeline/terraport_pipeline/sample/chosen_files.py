"""Which files of a survey are sampled, how much of each, and which part of all points they hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from terraport_pipeline.engines.readers.file_sample import text_share
from terraport_pipeline.engines.readers.survey_stream import FileHead, survey_size
from terraport_pipeline.survey.survey_files import SurveyFiles

__all__ = ["MAX_POINTS", "choose_files", "chosen_part", "expected_points", "points_by_lines"]

MAX_POINTS: Final = 5_000_000
"""Points that are read, about: some 15 seconds with all that is measured on them."""

MAX_FILES: Final = 100
"""Files that points are read of: of each at least a chunk, of 50,000 points as a rule."""


def expected_points(survey: SurveyFiles, heads: Sequence[FileHead]) -> int:
    """Points of a survey by its headers, within its extent; at least 1."""
    return max(1, survey_size(heads, survey.extent).points)


def choose_files(
    survey: SurveyFiles, heads: Sequence[FileHead], max_points: int = MAX_POINTS
) -> tuple[SurveyFiles, float]:
    """Choose the files to read points of, spread over all, and which share of each.

    Returns
    -------
    survey : SurveyFiles
        :data:`MAX_FILES` files at most; all where all points are read.
    share : float
        1 where the survey has no more points than `max_points`.
    """
    rows = [head.points if head.rows is None else head.rows for head in heads]
    if sum(rows) <= max_points:
        return survey, 1.0
    files = survey.files
    step = max(1.0, len(files) / MAX_FILES)
    numbers = sorted({int((i + 0.5) * step) for i in range(min(len(files), MAX_FILES))})
    chosen = replace(survey, files=tuple(files[number] for number in numbers))
    return chosen, min(1.0 - 1e-9, max_points / max(1, sum(rows[number] for number in numbers)))


def points_by_lines(
    survey: SurveyFiles,
    chosen: SurveyFiles,
    share: float,
    read: int,
    expected: int,
) -> int:
    """Points of a survey of text by how many lines of it were read; others say it themselves."""
    if any(file.format != "xyz" for file in survey.files):
        return expected
    taken = sum(file.bytes * text_share(file.bytes, share) for file in chosen.files)
    return round(read * survey.size_bytes / max(1.0, taken))


def chosen_part(chosen: SurveyFiles, survey: SurveyFiles, heads: Sequence[FileHead]) -> float:
    """Part of a survey's points that the chosen files hold."""
    paths = {file.path for file in chosen.files}
    held = [
        head.points for file, head in zip(survey.files, heads, strict=True) if file.path in paths
    ]
    return sum(held) / max(1, sum(head.points for head in heads))
