"""The survey that is worked on: as read, or over a scene with the samples of unchanged ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.geometry.clouds.height_changes import HEIGHT_CHANGE
from terraport_pipeline.geometry.tiles.tile_plan import Lattice
from terraport_pipeline.stages import renew
from terraport_pipeline.stages.contract import IN_FOLDER, Facts, Json
from terraport_pipeline.stages.partition import BLOCK_CELLS
from terraport_pipeline.stages.survey_change import SurveyChange, clashing_attribute
from terraport_pipeline.workflow.before import SURVEY, Before
from terraport_pipeline.workflow.runner import Runner, Stage
from terraport_pipeline.workflow.tile_ground import FRAME
from terraport_pipeline.workflow.workdir import StageRecord

__all__ = ["renew_survey", "survey_change"]

_MOST_DENSER: Final = 1.5
"""Points per area over those of the survey before, or the other way round, from which the scene is
built anew: cells and spacing are those of the first survey."""


def renew_survey(runner: Runner, read: StageRecord) -> tuple[StageRecord, tuple[str, ...]]:
    """Keep the samples of ground that did not change since the scene's last survey.

    Parameters
    ----------
    runner : Runner
        Without :attr:`~.Runner.before` afterwards where the scene is to be built anew.
    read : StageRecord
        The survey's columns.

    Returns
    -------
    survey : StageRecord
        The columns to work on.
    warnings : tuple of str
        Why the scene is built anew.
    """
    before = runner.before
    if before is None:
        return read, ()
    earlier, frame = before.find(SURVEY), before.find(FRAME)
    if earlier is None or frame is None:
        runner.before = None
        return read, ()
    differs = _difference(before, earlier, runner.work.path, read)
    if differs is None:
        renewed = _renew(runner, before, earlier, frame, read)
        denser = float(renewed.values.get("density_ratio", 1.0))
        if 1.0 / _MOST_DENSER <= denser <= _MOST_DENSER:
            return renewed, ()
        runner.work.forget(renewed.name)
        runner.reports.pop()
        differs = f"has {denser:.2g} times the points per area of the one before"
    runner.before = None
    return read, (f"the survey {differs}: the scene is built anew, and clients load all of it",)


def survey_change(runner: Runner, survey: StageRecord, lattice: Lattice) -> SurveyChange | None:
    """Open what a survey changed; None where it is the scene's first, or the scene is built anew.

    Parameters
    ----------
    runner : Runner
    survey : StageRecord
        From :func:`renew_survey`.
    lattice : Lattice
        Of the scene.
    """
    if survey.name != renew.NAME:
        return None
    folder = runner.work.path / survey.name
    return SurveyChange.load(folder, survey.values, lattice, BLOCK_CELLS, survey.digest)


def _renew(
    runner: Runner, before: Before, earlier: StageRecord, frame: StageRecord, read: StageRecord
) -> StageRecord:
    values, folder = frame.values, runner.work.path
    lattice = Lattice(tuple(values["anchor_m"]), values["cell_m"])
    measured = values["measured"]
    kept = ("attributes", "crs", "units", "format", "whole", "low", "high")
    stated = {name: read.values[name] for name in kept if name in read.values}
    return runner.run(
        Stage(
            renew.NAME,
            renew,
            lambda context: _with_values(
                renew.run(
                    before.work.path / earlier.name, folder / read.name,
                    len(stated["attributes"]), lattice, np.array(values["origin"]),
                    measured["surface_spacing_m"], measured["noise_m"], context,
                ),
                stated,
            ),
            IN_FOLDER,
            {"frame": dict(values)},
            {"before": earlier.digest, "after": read.digest},
        )
    ).record  # fmt: skip


def _with_values(
    result: tuple[Mapping[str, Json], Facts], stated: Mapping[str, Json]
) -> tuple[Mapping[str, Json], Facts]:
    """Say of the renewed survey what the read stage says of one."""
    values, facts = result
    taken = clashing_attribute(stated["attributes"])
    if taken is not None:
        text = (
            f"the survey's attribute {taken!r} stands where {HEIGHT_CHANGE} would: how far the "
            "ground's height changed is in the report alone; rename it to see both"
        )
        facts = replace(facts, warnings=(*facts.warnings, text))
    return {**values, **stated}, facts


def _difference(before: Before, earlier: StageRecord, work: Path, read: StageRecord) -> str | None:
    """Say what makes two surveys incomparable; None where nothing does."""
    for name, title in (("crs", "coordinate reference system"), ("attributes", "attributes")):
        if earlier.values.get(name) != read.values.get(name):
            return f"has other {title} than the one before"
    folders = before.work.path / earlier.name, work / read.name
    if len({(folder / "colours.npy").exists() for folder in folders}) > 1:
        return "has colours and the one before has none, or the other way round"
    for number, name in enumerate(read.values["attributes"]):
        types = {NpyReader(folder / f"attribute-{number}.npy").dtype for folder in folders}
        if len(types) > 1:
            return f"has {name} in another type than the one before"
    return None
