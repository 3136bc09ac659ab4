"""Which part of a scene is handed on: all of it, a box on the ground, some regions, or both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float64, Int64
from terraport_pipeline.errors import OptionError
from terraport_pipeline.export.frame import SurveyFrame
from terraport_pipeline.extent import Extent
from terraport_store import RegionNames, Scene, read_labels

__all__ = [
    "SelectedScene",
    "Selection",
    "choose_segments",
    "find_regions",
    "ground_extent",
]

_NAMED: Final = 8
"""Labels that a refusal lists."""


@dataclass(frozen=True, slots=True)
class Selection:
    """What is handed on."""

    extent: Extent | None = None
    """Range of easting and northing in the survey's unit; None for the whole ground."""
    regions: frozenset[int] | None = None
    """Regions by their number in this version; None for all."""
    stable_ids: tuple[int, ...] = ()
    """By region: what to call it; empty where the scene has none."""

    def name_of(self, regions: Int64) -> Int64:
        """Return the stable ids of regions (F,), or the numbers where there are none."""
        if not self.stable_ids:
            return regions
        named: Int64 = np.array([*self.stable_ids, -1], np.int64)[regions]
        return named


@dataclass(frozen=True, slots=True, eq=False)
class SelectedScene:
    """What every writer is given: a scene, its survey's coordinates, and how much of it."""

    scene: Scene
    """Open."""
    frame: SurveyFrame
    selection: Selection = field(default_factory=Selection)


def find_regions(
    scene: Scene, wanted: Sequence[str]
) -> tuple[frozenset[int] | None, tuple[int, ...]]:
    """Find regions by what people call them.

    Parameters
    ----------
    scene : Scene
        Open: numbers of regions are those of its version.
    wanted : sequence of str
        Labels (all regions of that label, whatever the case) or stable ids.

    Returns
    -------
    frozenset of int or None
        None where nothing is wanted: all of them.
    tuple of int
        Stable ids by region.

    Raises
    ------
    OptionError
        No region is called so.
    DamagedSceneError
        Regions or labels are not what the format says.
    """
    names = RegionNames.of(scene.regions)
    stable_ids = () if names.stable_ids is None else tuple(names.stable_ids.tolist())
    if not wanted:
        return None, stable_ids
    names = names.with_labels(read_labels(scene.files))
    count = len(scene.regions["regions"])
    chosen: set[int] = set()
    for text in wanted:
        matching = _regions_called(names, count, text.strip())
        if not matching:
            raise OptionError(f"region {text!r}; expected {_choices(names, count)}")
        chosen |= matching
    return frozenset(chosen), stable_ids


def _regions_called(names: RegionNames, count: int, text: str) -> set[int]:
    """Regions of a label; where none has it, the one of that stable id (or number)."""
    labels = {region: names.label(region) for region in range(count)}
    called = {r for r, label in labels.items() if label and label.casefold() == text.casefold()}
    if called or not text.isascii() or not text.isdigit():
        return called
    if names.stable_ids is None:
        return {int(text)} & set(range(count))
    return set(np.flatnonzero(names.stable_ids == int(text)).tolist())


def _choices(names: RegionNames, count: int) -> str:
    labels = sorted({label for r in range(count) if (label := names.label(r)) is not None})
    listed = ", ".join(repr(label) for label in labels[:_NAMED])
    more = "" if len(labels) <= _NAMED else f" and {len(labels) - _NAMED} more"
    numbers = range(count) if names.stable_ids is None else names.stable_ids.tolist()
    ids = f"a stable id, {min(numbers, default=0)} to {max(numbers, default=0)}"
    return (f"one of {listed}{more}, or {ids}" if labels else f"{ids}") + (
        " (terraport label SCENE lists them)"
    )


def choose_segments(selected: SelectedScene, within: Extent | None = None) -> Int64:
    """Choose the segments that may overlap a selection; all others do not.

    Parameters
    ----------
    selected : SelectedScene
    within : Extent, optional
        A window in plan coordinates, in addition to the selection's own extent.

    Returns
    -------
    ndarray of int64
        Ascending; may be empty.
    """
    index, selection = selected.scene.index, selected.selection
    keep: Bool = np.ones(len(index), np.bool_)
    if selection.regions is not None:
        listed = np.array(sorted(selection.regions), np.int64)
        keep &= np.isin(index.region.astype(np.int64), listed) | (index.region_count > 1)
    low, high = _ground_boxes(selected)
    for extent in (selection.extent, within):
        if extent is not None:
            keep &= (low <= (extent.xmax, extent.ymax)).all(axis=1)
            keep &= (high >= (extent.xmin, extent.ymin)).all(axis=1)
    return np.flatnonzero(keep)


def ground_extent(selected: SelectedScene) -> Extent:
    """Return the ground that a selection has: its extent, or the boxes of its segments.

    Raises
    ------
    OptionError
        There is nothing in it.
    """
    chosen = choose_segments(selected)
    low, high = _ground_boxes(selected)
    selection, frame = selected.selection, selected.frame
    if len(chosen) == 0:
        whole = Extent(*low.min(axis=0), *high.max(axis=0))
        unit = f" ({frame.unit_name})"
        asked = selection.extent and frame.extent_to_survey(selection.extent)
        raise OptionError(
            f"extent {asked}: nothing of the scene lies in it; the scene has "
            f"{_rounded(frame.extent_to_survey(whole))}{unit}, in the coordinates of its survey"
        )
    if selection.extent is None:
        return Extent(*low[chosen].min(axis=0), *high[chosen].max(axis=0))
    box = selection.extent
    left, bottom = np.maximum(low[chosen].min(axis=0), (box.xmin, box.ymin)).tolist()
    right, top = np.minimum(high[chosen].max(axis=0), (box.xmax, box.ymax)).tolist()
    return Extent(
        left, bottom, max(right, np.nextafter(left, np.inf)), max(top, np.nextafter(bottom, np.inf))
    )


def _ground_boxes(selected: SelectedScene) -> tuple[Float64, Float64]:
    """Least and greatest easting and northing of every segment, (S, 2) each."""
    bounds, frame = selected.scene.index.bounds, selected.frame
    # z is -north: the box's least northing is at its greatest z.
    low = frame.to_plan(bounds[:, [0, 1, 5]])[:, :2]
    high = frame.to_plan(bounds[:, [3, 4, 2]])[:, :2]
    return low, high


def _rounded(extent: Extent) -> str:
    return " ".join(f"{value:.1f}" for value in extent.values)
