"""From a sample to its survey: where there may be ground, and how much of a spot was read."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import Float64, Int64
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.engines.readers.survey_stream import FileHead
from terraport_pipeline.geometry.clouds.density_map import count_samples
from terraport_pipeline.geometry.tiles.tile_plan import Lattice
from terraport_pipeline.sample.sampled_points import point_blocks
from terraport_pipeline.stages import read_streamed
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.survey.one_survey import FAR
from terraport_pipeline.survey.survey_files import SurveyFiles
from terraport_store import SurveyUnits

__all__ = ["GroundBoxes", "measure_local_share"]

_MORE: Final = 4
"""What is read to tell how close pieces lie: so many times more of some files than..."""

_MORE_AT_LEAST: Final = 1.5
"""...and where it comes to less than that (files of one chunk) it tells nothing."""

_FULL_CELL_POINTS: Final = 16.0
"""Points in a cell of the raster that ground is measured by, were they spread over the whole box:
then no cell of any ground is empty by chance."""

_STATED_BOX: Final = 0.9
"""Share of the files that state their box from which on the boxes say where ground may be."""


@dataclass(frozen=True, slots=True)
class GroundBoxes:
    """Where ground may be, CRS frame, metres: the boxes of the files, or the sample's."""

    boxes: Float64
    """(N, 4) west, south, east, north."""

    @classmethod
    def of(
        cls,
        survey: SurveyFiles,
        heads: Sequence[FileHead],
        low: Float64,
        high: Float64,
        units: SurveyUnits,
    ) -> GroundBoxes:
        """Take the boxes that headers state, cut to the extent; else the sample's own.

        So too where a header's box holds a stray point: then it is as wide as a country.
        """
        stated = [(h.low, h.high) for h in heads if h.low is not None and h.high is not None]
        if len(stated) < _STATED_BOX * len(heads):
            return cls(np.array([[low[0], low[1], high[0], high[1]]]))
        if survey.extent is not None:
            stated = [survey.extent.clipped(*corners) for corners in stated]
        ends = np.array(stated, np.float64)[:, :, :2].reshape(-1, 2)
        corners = np.sort(units.to_metres(ends).reshape(-1, 2, 2), axis=1)
        if float(np.ptp(corners, axis=(0, 1)).max()) >= FAR:
            return cls(np.array([[low[0], low[1], high[0], high[1]]]))
        return cls(corners.reshape(-1, 4))

    @property
    def area_m2(self) -> float:
        """Of all, at most that of the box around them: tiles may overlap."""
        west, south, east, north = self.boxes.T
        each = float(((east - west) * (north - south)).sum())
        whole = float((east.max() - west.min()) * (north.max() - south.min()))
        return max(min(each, whole), 1e-6)

    @property
    def corners(self) -> tuple[Float64, Float64]:
        """South-west and north-east corner of the box around all."""
        return self.boxes[:, :2].min(axis=0), self.boxes[:, 2:].max(axis=0)

    def columns(self, lattice: Lattice, origin: Float64, block_cells: int) -> Int64:
        """Columns (x, z) of blocks of a lattice that touch a box, each once."""
        wide_m = block_cells * lattice.cell_m
        keys = []
        for west, south, east, north in self.boxes:
            x = (np.array([west, east]) - origin[0] - lattice.anchor_m[0]) / wide_m
            z = (np.array([-north, -south]) + origin[1] - lattice.anchor_m[2]) / wide_m
            columns = np.arange(math.floor(x[0]), math.ceil(x[1]) + 1)
            rows = np.arange(math.floor(z[0]), math.ceil(z[1]) + 1)
            keys.append(np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2))
        return np.unique(np.concatenate(keys), axis=0).astype(np.int64)


def measure_local_share(
    chosen: SurveyFiles,
    share: float,
    in_files: float,
    box: GroundBoxes,
    context: Context,
) -> float:
    """Which share of the points at a place are in the sample, by reading more and less of it.

    Parameters
    ----------
    chosen, share
        The files that the sample is of, and how much was read of each.
    in_files : float
        Share of the chosen files' points that is in it; other files lie elsewhere.
    box : GroundBoxes
        Where the survey may have ground.
    context : Context
    """
    # (1) Of many files some are looked at closer: there may be one piece of each in the sample.
    step = _MORE**2 if len(chosen.files) >= _MORE**2 else 1
    some = replace(chosen, files=chosen.files[step // 2 :: step])
    more = min(1.0, _MORE * share) if step > 1 else share
    # (2) How their ground grows with what is read of them.
    area_m2 = box.area_m2 * len(some.files) / len(chosen.files)
    west_south, east_north = box.corners
    points, covered_m2 = [], []
    cell_m = 0.0
    for part in (more / _MORE, more):  # the less first: the cells are wide enough for it
        with tempfile.TemporaryDirectory(prefix="part-", dir=context.folder) as scratch:
            folder = Path(scratch)
            inner = replace(context, scratch=folder, result_folder=folder)
            read_streamed.run(some, folder, inner, share=part)
            reader = NpyReader(folder / "points.npy")
            cell_m = cell_m or math.sqrt(_FULL_CELL_POINTS * area_m2 / max(len(reader), 1))
            points.append(len(reader))
            ground = count_samples(point_blocks(reader), west_south, east_north, cell_m)
            covered_m2.append(max(ground.effective_m2, cell_m**2))
    less, all_of_them = (max(count, 1) for count in points)
    in_files = min(1.0, in_files)
    if all_of_them < _MORE_AT_LEAST * less:
        return in_files
    exponent = math.log(covered_m2[1] / covered_m2[0]) / math.log(all_of_them / less)
    return float(in_files ** (1.0 - min(max(exponent, 0.0), 1.0)))
