"""Reads a survey as a build does, and puts its points back into the order that a test wrote."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from terraport_payload.types import Float64, Int64
from terraport_pipeline.model import Survey
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.survey.survey_files import SurveyFiles
from terraport_pipeline.survey_statement import SurveyStatement


class _CountedProgress:
    """A Progress that counts: no step may tell of more than its total."""

    def __init__(self) -> None:
        self.totals: list[float] = []
        self.amounts: list[float] = []

    def start(self, stage: str, total: float | None, unit: str) -> None:
        assert total is not None, stage
        self.totals.append(total)
        self.amounts.append(0.0)

    def advance(self, n: float) -> None:
        self.amounts[-1] += n
        assert self.amounts[-1] <= self.totals[-1]

    def done(self, facts: Mapping[str, object]) -> None:
        """Each step's facts are of no interest here."""


def read_in_order(path: Path, written: Float64, statement: SurveyStatement | None = None) -> Survey:
    """Read a survey that holds exactly the points `written`, in metres, to the millimetre.

    Progress is checked on the way: in the end, all of each step was told of.
    """
    progress = _CountedProgress()
    files = SurveyFiles.of(path)
    if statement is not None:
        files = replace(files, statement=statement)
    survey = read_survey(files, progress=progress)
    assert progress.amounts == progress.totals, (progress.amounts, progress.totals)
    read_mm, written_mm = _millimetres(survey.points), _millimetres(written)
    read_order, written_order = np.lexsort(read_mm.T), np.lexsort(written_mm.T)
    np.testing.assert_array_equal(read_mm[read_order], written_mm[written_order])
    rows = np.empty(len(written), np.int64)
    rows[written_order] = read_order
    return replace(
        survey,
        points=survey.points[rows],
        colours=None if survey.colours is None else survey.colours[rows],
        attributes={name: values[rows] for name, values in survey.attributes.items()},
    )


def _millimetres(points: Float64) -> Int64:
    ticks: Int64 = np.rint(points * 1000.0).astype(np.int64)
    return ticks
