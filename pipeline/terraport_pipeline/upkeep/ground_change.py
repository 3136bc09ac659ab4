"""Height differences of two scenes where their segments differ.

Where both have the same segments the ground is the same: only pixels over other segments are
compared. There are no volumes here: noise of two surfaces would appear as cut and fill. Volumes are
measured from the points when a survey is built over the previous scene.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Float64
from terraport_pipeline.errors import OptionError
from terraport_pipeline.export.frame import SurveyFrame
from terraport_pipeline.export.raster_grid import make_grid
from terraport_pipeline.export.sampling import both_heights
from terraport_pipeline.export.selection import SelectedScene
from terraport_pipeline.extent import Extent
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.upkeep.difference import Difference
from terraport_store import Manifest, Scene

__all__ = ["MAX_PIXELS", "GroundChange", "ground_change", "why_not"]

MAX_PIXELS: Final = 1_000_000
"""Over the ground that differs; the step follows."""

_FINEST_M: Final = 0.05
_STEPS: Final = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class GroundChange:
    """Second less first, seen from straight above; metres."""

    step_m: float
    area_m2: float
    """Over which both have ground and either has another segment."""
    lowest_m: float | None
    highest_m: float | None
    """None where there is no such ground."""


def why_not(first: Manifest, second: Manifest) -> str | None:
    """Say why heights cannot be compared; None where they can."""
    one, other = first.crs, second.crs
    if (one is None) != (other is None):
        return "only one of them states a coordinate reference system"
    if one is not None and other is not None and (one.name, one.epsg) != (other.name, other.epsg):
        return f"they are in {one.name} and in {other.name}"
    return None


def ground_change(
    scenes: tuple[Scene, Scene], difference: Difference, progress: Progress | None = None
) -> GroundChange | None:
    """Compare heights by vertical rays.

    Parameters
    ----------
    scenes : tuple of Scene
        Open; :func:`why_not` has been asked.
    difference : Difference
        Of the same two.
    progress : Progress, optional
        A step of pixels.

    Returns
    -------
    GroundChange or None
        None where no ground of both lies under segments that differ.

    Raises
    ------
    DamagedSceneError
        A payload fails its hash or does not decode.
    """
    # (1) Boxes of what differs: west, south, east, north, metres.
    origins = scenes[0].manifest.origin, scenes[1].manifest.origin
    first, second = (
        SelectedScene(scene, SurveyFrame(origin, None))
        for scene, origin in zip(scenes, origins, strict=True)
    )
    ground = [_boxes(first), _boxes(second)]
    differs = [~difference.kept_first, ~difference.kept_second]
    if origins[0] != origins[1]:
        # The same payload lies elsewhere.
        differs = [np.ones_like(of_side) for of_side in differs]
    differing = np.concatenate([boxes[at] for boxes, at in zip(ground, differs, strict=True)])
    low = np.maximum(*(boxes[:, :2].min(axis=0) for boxes in ground))
    high = np.minimum(*(boxes[:, 2:].max(axis=0) for boxes in ground))
    differing[:, :2] = np.maximum(differing[:, :2], low)
    differing[:, 2:] = np.minimum(differing[:, 2:], high)
    differing = differing[(differing[:, :2] < differing[:, 2:]).all(axis=1)]
    if len(differing) == 0:
        return None
    extent = Extent(*differing[:, :2].min(axis=0), *differing[:, 2:].max(axis=0))
    step_m = _step_m(extent)
    try:
        grid = make_grid(extent, step_m)
    except OptionError:  # narrower than a pixel
        return None

    # (2) Windows that anything differs in.
    def is_asked(window: Extent) -> bool:
        below = (differing[:, :2] < (window.xmax, window.ymax)).all(axis=1)
        above = (differing[:, 2:] > (window.xmin, window.ymin)).all(axis=1)
        return bool((below & above).any())

    progress = progress or NullProgress()
    progress.start("heights", grid.rows * grid.columns, "pixels")
    pixels, lowest, highest = 0, math.inf, -math.inf
    for window, before, after in both_heights(first, second, grid, is_asked):
        change: Float32 = (after - before)[np.isfinite(before) & np.isfinite(after)]
        progress.advance(window.rows * window.columns)
        if len(change) == 0:
            continue
        pixels += len(change)
        lowest, highest = min(lowest, float(change.min())), max(highest, float(change.max()))
    progress.done({})
    if pixels == 0:
        return None
    return GroundChange(step_m, pixels * step_m**2, lowest, highest)


def _step_m(extent: Extent) -> float:
    """1, 2 or 5 of a power of ten, so that the pixels are few enough."""
    area = (extent.xmax - extent.xmin) * (extent.ymax - extent.ymin)
    least = max(math.sqrt(area / MAX_PIXELS), _FINEST_M)
    power = 10.0 ** math.floor(math.log10(least))
    return next(digit * power for digit in _STEPS if digit * power >= least * (1 - 1e-9))


def _boxes(selected: SelectedScene) -> Float64:
    """(S, 4) least easting and northing, greatest easting and northing of every segment."""
    bounds, frame = selected.scene.index.bounds, selected.frame
    low, high = frame.to_plan(bounds[:, [0, 1, 5]]), frame.to_plan(bounds[:, [3, 4, 2]])
    return np.concatenate([low[:, :2], high[:, :2]], axis=1)
