"""``terraport demo``, the part before the server: a sample quarry, its scene, its report."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from terraport_pipeline.announced import announced
from terraport_pipeline.demo_scenes import QUARRY_ID, QUARRY_NAME
from terraport_pipeline.errors import OptionError
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.report.input_cloud import find_input_cloud
from terraport_pipeline.report.picture import PictureOptions
from terraport_pipeline.report.report import ReportOptions, ReportResult, write_report
from terraport_pipeline.report.textures import open_scene_photos
from terraport_pipeline.synth.files import WrittenQuarry, write_quarry
from terraport_pipeline.synth.flight import seen_by
from terraport_pipeline.synth.options import FlightOptions, QuarryOptions
from terraport_pipeline.synth.photo_files import WrittenPhotos, write_photos
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_pipeline.workflow.report import BuildReport

__all__ = ["FLIGHT", "DemoScene", "prepare_demo"]

REPORT: Final = ReportOptions(PictureOptions(960, 540), rays=100_000, subsets=30)
"""Smaller than ``terraport report`` makes it, so that the demo stays within two minutes, and
within four the first time, when kernels are compiled."""

FLIGHT: Final = FlightOptions(count=32, width=392, height=294, way_share=0.47)
"""Few and small: 7 million pixels take 20 s, and show twice finer than the points lie."""

POINT_RANGE: Final = (20_000, 20_000_000)
"""Fewer points make no benches; more make no demo."""


@dataclass(frozen=True, slots=True)
class DemoScene:
    """Files of the demo (cloud, photos, scene, report), and the seconds that each step took."""

    scenes_dir: Path
    """Root folder for ``terraport serve``."""
    scene: Path
    quarry: WrittenQuarry
    report: ReportResult
    build: BuildReport
    photos: WrittenPhotos | None
    seconds: tuple[tuple[str, float], ...]
    """Each step and its time."""


def prepare_demo(
    directory: Path,
    *,
    points: int,
    seed: int = 7,
    flight: FlightOptions | None = FLIGHT,
    progress: Progress | None = None,
) -> DemoScene:
    """Make the sample quarry's cloud and photos, build the scene, and write its report.

    Parameters
    ----------
    directory : Path
        Where everything goes; must exist. ``quarry.laz``, ``photos`` and ``scenes/quarry`` in it
        are replaced.
    points : int
        Points of the cloud.
    seed : int
        Shape of the quarry; the same gives the same scene, byte for byte.
    flight : FlightOptions or None
        The photos for its textures; None leaves vertex colours.
    progress : Progress, optional
        Watches all steps.

    Returns
    -------
    DemoScene

    Raises
    ------
    OptionError
        For a number of points that makes no demo.
    PipelineError, StoreError
        What building and reporting raise.
    """
    low, high = POINT_RANGE
    if not low <= points <= high:
        raise OptionError(f"received {points:,} points, expected {low:,} to {high:,} for a demo")
    watcher = progress or NullProgress()
    scenes = directory / "scenes"
    scenes.mkdir(exist_ok=True)
    scene = scenes / QUARRY_ID
    seconds: list[tuple[str, float]] = []

    def took(step: str, start: float) -> None:
        seconds.append((step, time.perf_counter() - start))

    start = time.perf_counter()
    # (1) A cloud, large enough for the flight to look at.
    options = QuarryOptions(points=points, seed=seed, way_density=6.0)
    if flight is not None:
        options = seen_by(flight, options)
    photos, folder = None, directory / "photos"
    with announced(scene, QUARRY_NAME, watcher) as surveying:
        quarry = write_quarry(options, directory / "quarry.laz", overwrite=True, progress=surveying)
        took("make a quarry", start)
        # (2) Its photos.
        if flight is not None:
            start = time.perf_counter()
            photos = write_photos(
                options, flight, folder, survey="quarry.laz", overwrite=True, progress=surveying
            )
            took("photograph it", start)
    start = time.perf_counter()
    # (3) The scene, as `terraport build` makes it.
    images = folder / "images"
    built = build(
        BuildOptions(
            quarry.survey_path,
            scene,
            name=QUARRY_NAME,
            texture=None if photos is None else Texturing(photos=images, cameras=folder / "colmap"),
            work=directory / "work",
        ),
        watcher,
    )
    took("build the scene", start)
    start = time.perf_counter()
    # (4) Its report.
    report = write_report(
        scene,
        options=REPORT,
        cloud=lambda opened: find_input_cloud(opened, directory / "work"),
        photos=(
            None
            if photos is None
            else lambda model: open_scene_photos(model, images, folder / "colmap")
        ),
        work=directory / "work",
        progress=watcher,
    )
    took("write the report", start)
    return DemoScene(scenes, scene, quarry, report, built, photos, tuple(seconds))
