"""Faces, time and memory of Poisson against octree depth: the thesis's Figure 5.8."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines import poisson
from terraport_pipeline.errors import SurveyError
from terraport_pipeline.progress import Progress
from terraport_pipeline.stages import clean
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import synthesise
from terraport_research.reconstructors import Samples
from terraport_research.runs import run

__all__ = ["KNOWN_SCENES", "DepthRow", "DepthScene", "find_scene", "sweep"]

KNOWN_SCENES: Final = {
    "red_rocks": ("Red Rocks", "red_rocks/red_rocks.laz"),
    "apaxco_quarry": ("Apaxco quarry", "apaxco_quarry/apaxco_quarry_500k.laz"),
    "churo_andes": ("Churo, Andes", "churo_andes/churo_andes.laz"),
}
"""Title and place in a data folder. The thesis had the Swiss quarry, Red Rocks and Gravel quarry
datasets; of these Red Rocks is one of ours too."""


@dataclass(frozen=True, slots=True)
class DepthRow:
    """Faces, CPU time and memory of one reconstruction at one octree depth."""

    depth: int
    faces: int
    """After trimming: on the survey."""
    solved_faces: int
    cpu_s: float
    memory_bytes: int
    """Added while it ran, the solver's process included."""
    error: str = ""


@dataclass(frozen=True, slots=True)
class DepthScene:
    """One scene of Figure 5.8, reconstructed at every depth: one line of the chart."""

    key: str
    title: str
    points: int
    spacing_m: float
    extent_m: float
    our_depth: int
    """What ``terraport build`` takes by density."""
    rows: tuple[DepthRow, ...]


def find_scene(name: str, data: Path | None) -> tuple[str, Path | None]:
    """Find a scene by name or path: its title and its file (None for the synthetic quarry).

    Raises
    ------
    SurveyError
        There is no such file; the text says what to do.
    """
    if name == "quarry":
        return "Synthetic quarry", None
    if name in KNOWN_SCENES:
        title, where = KNOWN_SCENES[name]
        if data is None:
            raise SurveyError(f"{name} not looked for: name the folder of real data with --data")
        path = data / where
    else:
        path = Path(name)
        title = path.stem
    if not path.is_file():
        raise SurveyError(f"{path} is not there")
    return title, path


def sweep(
    name: str,
    data: Path | None,
    depths: Sequence[int],
    points: int,
    scratch: Path,
    *,
    threads: int,
    progress: Progress,
) -> DepthScene:
    """Reconstruct one scene at several depths, as many at once as there are threads.

    Parameters
    ----------
    name : str
        ``quarry``, a key of :data:`KNOWN_SCENES`, or the path of a survey.
    data : Path, optional
        Folder of real data.
    depths : sequence of int
    points : int
        The survey is thinned to this many.
    scratch : Path
    threads : int
    progress : Progress

    Returns
    -------
    DepthScene

    Raises
    ------
    SurveyError
        The scene is not there, or is no surface.
    """
    # (1) The survey, real or made.
    title, path = find_scene(name, data)
    if path is None:
        survey = synthesise(QuarryOptions(points=points)).survey
    else:
        survey = read_survey(path, max_points=points)
    # (2) Clean it once for all depths.
    cleaned = clean.run(survey, clean.Options(), Context(scratch, threads=threads))
    cloud = cleaned.cloud
    samples = Samples(
        cloud.points, cloud.normals, cloud.colours, cleaned.local_spacing_m, cloud.spacing_m
    )
    extent_m = float(np.ptp(cloud.points, axis=0).max())

    def one(depth: int) -> DepthRow:
        result = run("poisson", samples, scratch, depth=depth)
        if result.surface is None:
            return DepthRow(depth, 0, 0, result.cpu_s, result.added_bytes, result.error)
        surface = result.surface
        return DepthRow(
            depth, len(surface.faces), surface.solved_faces, result.cpu_s, result.added_bytes
        )

    # (3) Every depth in a process of its own.
    rows = []
    with ThreadPoolExecutor(max(1, threads)) as pool:
        # The deepest first: they take longest, and a short one last leaves no core idle.
        for row in pool.map(one, sorted(depths, reverse=True)):
            rows.append(row)
            progress.advance(1)
    # (4) In order of the depth, whatever was done first.
    return DepthScene(
        name if path is None or name in KNOWN_SCENES else path.stem,
        title,
        len(cloud.points),
        cloud.spacing_m,
        extent_m,
        poisson.depth_for(max(depths), extent_m, cloud.spacing_m),
        tuple(sorted(rows, key=lambda row: row.depth)),
    )
