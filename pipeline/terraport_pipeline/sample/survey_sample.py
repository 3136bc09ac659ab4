"""A bounded look at the points of a survey: what ``inspect`` says beyond the files' headers.

Up to :data:`MAX_POINTS` points are read, by the reader of the build, so that units, columns and
colours are what a build makes of them. Of a larger survey they are whole pieces of its files,
spread over them. The survey's measures, and the plan of its tiles, come from the functions that a
build calls; what they say of a sample is brought to the whole survey by its ground:

- Pieces of a file may lie close (scans, tiles), as dense as the whole, or anywhere, so much thinner
  as little was read. Which of the two is seen by reading a quarter of it, too: where pieces lie
  close that covers a quarter of the ground, where points come in any order all of it. The exponent
  between them says which share of the points at a place is in the sample.
- Spacing is that of the sample times the root of that share, surface and ground follow from it.

Memory: one part of a file, 24 bytes a point for copies, and the thinned copy (75 MB). Disk: the
sample twice, in a folder that goes again.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.engines.readers.survey_stream import FileHead
from terraport_pipeline.geometry.clouds.density_map import DensityMap, Gap, find_gaps
from terraport_pipeline.geometry.clouds.outliers import duplicate_mask
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.sample.chosen_files import (
    MAX_POINTS,
    choose_files,
    chosen_part,
    expected_points,
    points_by_lines,
)
from terraport_pipeline.sample.local_share import GroundBoxes, measure_local_share
from terraport_pipeline.sample.planned_ground import plan_ground
from terraport_pipeline.sample.sampled_points import density_of, mean_slant, thinned
from terraport_pipeline.sample.sampled_values import Colours, Column, colours_of, column_of
from terraport_pipeline.stages import clean, measure_survey, read_streamed
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.survey.survey_files import SurveyFiles
from terraport_pipeline.workflow.build_forecast import SolvedGround
from terraport_store import SurveyUnits

__all__ = ["SurveySample", "sample_survey"]

_GAP_CELLS: Final = 4
"""A gap has so many of them at least."""


@dataclass(frozen=True, slots=True, eq=False)
class SurveySample:
    """What was read and measured of a survey; metres, and what is counted is of the sample."""

    read: int
    """Points that were read, repeats among them."""
    points: int
    """Of the whole survey: by the headers, or for text by what was read."""
    whole: bool
    """Every point was read."""
    files: int
    warnings: tuple[str, ...]
    """What a build would say of reading and cleaning."""
    units: SurveyUnits
    """Units and axes of the survey's own coordinates."""
    low: Float64
    high: Float64
    """(3,) corners of the sample's box, CRS frame."""
    measured: Mapping[str, Any]
    """As :mod:`measure_survey` gives, of the whole survey."""
    ground_m2: float
    """Of the whole survey, seen from above."""
    surface_m2: float
    density: DensityMap
    """Samples per cell; :attr:`local_share` of those that lie there in the whole survey."""
    local_share: float
    gaps: tuple[Gap, ...]
    repeats: int
    """Records that another one equals in every value."""
    copies: int
    """Further points at the place of another, with other values."""
    outliers: float
    """Share of the thinned copy that cleaning takes for outliers."""
    colours: Colours | None
    attributes: tuple[Column, ...]
    ground: SolvedGround
    """What a build would solve."""


def sample_survey(
    survey: SurveyFiles,
    heads: Sequence[FileHead],
    *,
    max_memory_bytes: int,
    max_points: int = MAX_POINTS,
    threads: int = 1,
    progress: Progress | None = None,
) -> SurveySample:
    """Read and measure a bounded part of a survey.

    Parameters
    ----------
    survey : SurveyFiles
        Without damaged files.
    heads : sequence of FileHead
        Of its files.
    max_memory_bytes : int
        That a build may take: tiles are chosen by it.
    max_points : int
        Points that are read, about.
    threads : int
    progress : Progress, optional

    Raises
    ------
    ReadError, SurveyError
        What would end a build, too: degrees, too few points, no relief, a damaged file.
    """
    progress = progress or NullProgress()
    expected = expected_points(survey, heads)
    chosen, share = choose_files(survey, heads, max_points)
    with tempfile.TemporaryDirectory(prefix="terraport-inspect-") as scratch:
        # (1) Points as the build reads them, and of a sample a quarter again.
        folder = Path(scratch)
        context = Context(folder, progress, threads, result_folder=folder)
        values, facts = read_streamed.run(chosen, folder, context, share=share, bounded=share < 1.0)
        points = NpyReader(folder / "points.npy")
        read = sum(file["points"] - file["outside"] for file in facts.notes["files"])
        repeats = sum(file["repeats"] for file in facts.notes["files"])
        if share < 1.0:
            read = len(points) + repeats
            expected = points_by_lines(survey, chosen, share, read, expected)
        count = read if share >= 1.0 else max(expected, read)
        low, high = np.array(facts.counts["low"]), np.array(facts.counts["high"])
        units = SurveyUnits(**values.get("units", {"horizontal_m": 1.0, "height_m": 1.0}))
        box = GroundBoxes.of(survey, heads, low, high, units)
        local_share = 1.0
        if share < 1.0:
            local_share = measure_local_share(
                chosen, share, len(points) / count / chosen_part(chosen, survey, heads),
                box, context,
            )  # fmt: skip
        # (2) Spacing, noise and normals: the build's measures, of the whole sample.
        cleaned = clean.run(thinned(points, values), clean.Options(), context)
        measured = dict(
            measure_survey.run(
                points.path, cleaned.cloud, clean.Options().normal_neighbours, context
            ).values
        )
        slant = mean_slant(points, low, measured, threads)
        # (3) From the sample to the survey.
        for name in ("spacing_m", "surface_spacing_m"):
            measured[name] *= math.sqrt(local_share)
        once = round(count * len(points) / max(1, read))  # a build takes repeats once
        surface_m2 = once * measured["surface_spacing_m"] ** 2
        # (4) The map, and what is missing in it.
        sample_spacing_m = measured["surface_spacing_m"] / math.sqrt(local_share)
        density = density_of(points, low, high, sample_spacing_m)
        if share >= 1.0:
            ground_m2 = density.area_m2
        else:
            upright = float(np.abs(cleaned.cloud.normals[:, 1].astype(np.float64)).mean())
            ground_m2 = min(upright * surface_m2, box.area_m2)
        gaps = find_gaps(density, _GAP_CELLS) if share >= 1.0 else []
        # (5) Values, and what a build would solve.
        copies = int(duplicate_mask(points.read(0, len(points))).sum())
        ground = plan_ground(
            folder, measured, cleaned.cloud.origin, box, once, surface_m2,
            ground_m2, slant, max_memory_bytes, context,
            is_sample=share < 1.0,
        )  # fmt: skip
        return SurveySample(
            read=read,
            points=count,
            whole=share >= 1.0,
            files=len(chosen.files),
            warnings=(*facts.warnings, *cleaned.facts.warnings),
            units=units,
            low=low,
            high=high,
            measured=measured,
            ground_m2=ground_m2,
            surface_m2=surface_m2,
            density=density,
            local_share=local_share,
            gaps=tuple(gaps),
            repeats=repeats,
            copies=copies,
            outliers=cleaned.facts.counts["outliers"] / max(1, len(cleaned.cloud.points)),
            colours=colours_of(folder, facts.notes["colours"]),
            attributes=tuple(
                column_of(name, NpyReader(folder / f"attribute-{number}.npy"))
                for number, name in enumerate(values["attributes"])
            ),
            ground=ground,
        )
