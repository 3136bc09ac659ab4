"""The points of the input for the report's picture, from the build's work directory.

A scene does not hold the survey's points. The build's clean stage leaves them, of a large survey a
thinned copy, already in the scene frame, as plain NumPy files; where they are still there and
belong to the published scene they are taken from there. Nothing is written, and nothing is
unpickled.
"""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import Float32
from terraport_pipeline.model import to_scene
from terraport_pipeline.published.work_directory import default_work_directory
from terraport_pipeline.report.pictures import InputCloud
from terraport_store import Scene

__all__ = ["find_input_cloud"]

MAX_POINTS: Final = 2_000_000
"""Points taken; of a larger cloud every n-th."""

MAX_SAMPLES: Final = 400_000
"""Points as they were read that are taken, about, to measure the mesh by."""

MAX_RECORD_BYTES: Final = 4 << 20
"""Largest stage.json that is read."""

MAX_TILES: Final = 100_000
"""Tiles whose records are read."""


def find_input_cloud(scene: Scene, work: Path | None = None) -> InputCloud | None:
    """Look for the points that a scene was built from.

    Parameters
    ----------
    scene : Scene
        Open.
    work : Path, optional
        The build's work directory; ``.<scene>.work`` beside the scene by default.

    Returns
    -------
    InputCloud or None
        None when they are not there, are damaged, or belong to another build (another origin or
        number of points): a report goes without.
    """
    folder = (work or default_work_directory(scene.path)) / "clean"
    try:
        with (folder / "stage.json").open("rb") as file:
            record = json.loads(file.read(MAX_RECORD_BYTES))
        spacing_m = float(record["values"]["spacing_m"])
        arrays = {
            name: np.load(folder / f"{name}.npy", mmap_mode="r", allow_pickle=False)
            for name in ("points", "colours", "origin")
        }
    except (OSError, ValueError, KeyError, TypeError, EOFError):
        return None
    points, colours = arrays["points"], arrays["colours"]
    kept = total = len(points)
    if kept != scene.manifest.counts.points:
        total = _points_of_tiles(folder.parent)
    fits = (
        points.shape == colours.shape == (kept, 3)
        and total == scene.manifest.counts.points
        and np.array_equal(arrays["origin"], scene.manifest.origin)
        and np.isfinite(spacing_m)
        and spacing_m > 0
    )
    if not fits:
        return None
    step = max(1, -(-kept // MAX_POINTS))
    # Copied: the picture outlives the mapping. Fewer points stand further apart.
    return InputCloud(
        np.array(points[::step], dtype=np.float32),
        np.array(colours[::step], dtype=np.uint8),
        spacing_m * step**0.5,
        total,
        *_as_read(scene, folder.parent / "read"),
    )


def _as_read(scene: Scene, folder: Path) -> tuple[Float32 | None, int]:
    """Take a sample of the points as they were read for this scene, and their number."""
    source = scene.manifest.build.input
    try:
        with (folder / "stage.json").open("rb") as file:
            digest = str(json.loads(file.read(MAX_RECORD_BYTES))["digest"])
        points = np.load(folder / "points.npy", mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, KeyError, TypeError, EOFError):
        return None, 0
    if source is None or not digest.startswith(source.xxh3):
        return None, 0
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        return None, 0
    step = max(1, len(points) // MAX_SAMPLES)
    origin = np.array(scene.manifest.origin)
    return to_scene(np.array(points[::step], dtype=np.float64), origin), len(points)


def _points_of_tiles(work: Path) -> int:
    """Add up the points of all tiles, where the clean stage holds a thinned copy; 0 for none."""
    total = 0
    try:
        for record in islice(work.glob("solve-*/stage.json"), MAX_TILES):
            with record.open("rb") as file:
                total += int(json.loads(file.read(MAX_RECORD_BYTES))["values"]["core"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0
    return total
