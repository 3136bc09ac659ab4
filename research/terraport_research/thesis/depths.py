"""Figures 5.5 to 5.7: one survey reconstructed at several octree depths, side by side."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines.cameras import oblique
from terraport_pipeline.errors import PipelineError
from terraport_pipeline.progress import Progress
from terraport_pipeline.stages import clean
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import synthesise
from terraport_research.booklet_model import Column, Row, Table
from terraport_research.depth_sweep import find_scene
from terraport_research.options import ThesisOptions
from terraport_research.reconstructors import Samples
from terraport_research.runs import run
from terraport_research.thesis.making import SIZE, Made, Making, plain_picture

__all__ = ["make_depths"]

KEY: Final = "depths"
_SCENES: Final = ("apaxco_quarry", "red_rocks", "quarry")
"""For the thesis's Swiss quarry, Red Rocks and Gravel quarry."""
_CLOSE_SHARE: Final = 0.25
"""Side of what is drawn, of the survey's: at a whole survey's size depths look alike."""


def make_depths(options: ThesisOptions, progress: Progress) -> Made:
    """Reconstruct three surveys at every depth and draw a quarter of each."""
    mode = f"{options.depth_points:,} points a survey, trimmed as in a build"
    making = Making(KEY, "Octree depths: Figures 5.5 to 5.7", mode, options.seed)
    making.say(
        "Poisson reconstruction; the middle of each survey, all depths from one camera. The Swiss "
        "and the Gravel quarry datasets are not ours to hand out: another quarry and a synthetic "
        "one stand for them; Red Rocks is the thesis's own. Without --data the synthetic quarry "
        "alone."
    )
    columns = (
        Column("faces", "faces", 0),
        Column("cpu_s", "CPU s", 1),
        Column("memory", "memory", 0, "MiB"),
    )
    progress.start("octree depths", float(len(_SCENES) * len(options.depths)), "depths")
    with tempfile.TemporaryDirectory(prefix="terraport-evaluate-") as folder:
        for number, name in enumerate(_SCENES):
            figure = f"5.{number + 5}"
            try:
                title, samples = _samples(name, options, Path(folder))
            except PipelineError as error:
                making.say(f"Figure {figure} was not made: {error}.")
                progress.advance(len(options.depths))
                continue
            rows: list[Row] = []
            pictures: list[tuple[str, str, bytes | None]] = []
            shapes: list[tuple[str, str, bytes | None]] = []
            middle = samples.points[_middle(samples)]
            camera = oblique(middle[:: max(1, len(middle) // 4000)], aspect=SIZE[0] / SIZE[1])
            for depth in options.depths:
                result = run("poisson", samples, Path(folder), depth=depth)
                making.spent(result.cpu_s)
                progress.advance(1)
                if result.surface is None or result.colours is None:
                    rows.append(Row(f"depth {depth}", (None, None, None), note=result.error))
                    pictures.append((f"depth {depth}", f"failed: {result.error}", None))
                    continue
                count = len(result.surface.faces)
                rows.append(
                    Row(
                        f"depth {depth}",
                        (float(count), result.cpu_s, result.added_bytes / 2**20),
                    )
                )
                jpeg = plain_picture(
                    result.surface.vertices, result.surface.faces, camera, result.colours
                )
                shape = plain_picture(result.surface.vertices, result.surface.faces, camera)
                pictures.append((f"depth {depth}", f"{count:,} faces", jpeg))
                shapes.append((f"depth {depth}, shape alone", f"{count:,} faces", shape))
            making.tables.append(
                Table(figure, f"Figure {figure} in numbers: {title}", "depth", columns,
                      tuple(rows))
            )  # fmt: skip
            making.figure(figure, f"Figure {figure}: {title}", pictures + shapes)
    progress.done({})
    return making.made()


def _samples(name: str, options: ThesisOptions, scratch: Path) -> tuple[str, Samples]:
    title, path = find_scene(name, options.data)
    if path is None:
        survey = synthesise(QuarryOptions(points=options.depth_points, seed=options.seed)).survey
    else:
        survey = read_survey(path, max_points=options.depth_points)
    cleaned = clean.run(survey, clean.Options(), Context(scratch, threads=1))
    cloud = cleaned.cloud
    return title, Samples(
        cloud.points, cloud.normals, cloud.colours, cleaned.local_spacing_m, cloud.spacing_m
    )


def _middle(samples: Samples) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Say which samples lie in the middle of the survey."""
    plan = samples.points[:, [0, 2]]
    low, high = np.percentile(plan, [1, 99], axis=0)
    half = (high - low) / 2 * _CLOSE_SHARE
    inside: np.ndarray[tuple[int], np.dtype[np.bool_]] = (
        np.abs(plan - (low + high) / 2) < half
    ).all(axis=1)
    return inside
