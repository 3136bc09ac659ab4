"""What the last survey changed, for the report: the raster of the build, and volumes by region.

The raster lies in the build's work directory, as the points of the input do; it is taken where it
belongs to the published scene. Volumes stand in ``regions.json``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float32, UInt8
from terraport_pipeline.engines.palettes import NO_VALUE, diverging_colours
from terraport_pipeline.geometry.regions.region_changes import ChangeMap
from terraport_pipeline.model import Mesh
from terraport_pipeline.published.work_directory import default_work_directory
from terraport_pipeline.report.survey_units import SurveyUnit
from terraport_pipeline.stages.survey_change import load_change_map
from terraport_store import Scene

__all__ = ["ChangeFacts", "change_colours", "change_facts", "change_span_m", "find_change_map"]

MAX_RECORD_BYTES: Final = 4 << 20
"""Largest stage.json that is read."""

MAX_REGIONS: Final = 20
"""Regions that the table lists, largest volumes first; the others are one row."""

_FIELDS: Final = ("cut_m3", "fill_m3", "uncertainty_m3", "area_m2")


@dataclass(frozen=True, slots=True)
class ChangeFacts:
    """Volumes between the last two surveys."""

    rows: tuple[dict[str, Any], ...]
    """``name`` (stable id), ``label``, ``region`` (None for sums), and the volumes as text."""
    has_map: bool
    """There is a picture, too."""


def find_change_map(scene: Scene, work: Path | None = None) -> ChangeMap | None:
    """Look for the raster of the survey that a scene was renewed by.

    Parameters
    ----------
    scene : Scene
        Open.
    work : Path, optional
        The build's work directory; ``.<scene>.work`` beside the scene by default.

    Returns
    -------
    ChangeMap or None
        None for a first survey, and where the raster is not there, is damaged, or belongs to
        another build: a report goes without.
    """
    stated = _counts(scene)
    if stated is None:
        return None
    folder = (work or default_work_directory(scene.path)) / "renew"
    try:
        with (folder / "stage.json").open("rb") as file:
            record = json.loads(file.read(MAX_RECORD_BYTES))
        if record["facts"]["counts"] != stated:
            return None
        return load_change_map(folder, record["values"])
    except (OSError, ValueError, KeyError, TypeError, EOFError):
        return None


def _counts(scene: Scene) -> Mapping[str, Any] | None:
    """Look up what the published build says of its renew stage; None where it had none."""
    for stage in scene.manifest.build.stages:
        counts = stage.get("counts")
        if stage.get("name") == "renew" and isinstance(counts, Mapping):
            return counts
    return None


def change_facts(
    document: Mapping[str, Any],
    rows: list[dict[str, Any]],
    *,
    has_map: bool,
    unit: SurveyUnit | None = None,
) -> ChangeFacts | None:
    """Tabulate volumes of cut and fill.

    Parameters
    ----------
    document : mapping
        Contents of regions.json.
    rows : list of dict
        Of :func:`terraport_pipeline.region_table.region_rows`.
    has_map : bool
    unit : SurveyUnit, optional
        Of the survey; metres by default.

    Returns
    -------
    ChangeFacts or None
        None where the scene was not built over another. The rows add up to the last one.
    """
    change = document.get("change")
    if not isinstance(change, Mapping):
        return None
    named, own = {row["region"]: row for row in rows}, unit or SurveyUnit()
    volumes = [
        (region, _volumes(facts.get("change")))
        for region, facts in enumerate(document.get("regions", []))
        if isinstance(facts, Mapping) and isinstance(facts.get("change"), Mapping)
    ]
    volumes.sort(key=lambda pair: -(pair[1]["cut_m3"] + pair[1]["fill_m3"]))
    table = []
    for region, sums in volumes[:MAX_REGIONS]:
        row = named[region]
        number = region if row["stable_id"] is None else row["stable_id"]
        table.append(_row(str(number), row["label"], region, sums, own))
    others = [sums for _, sums in volumes[MAX_REGIONS:]]
    if others:
        summed = {name: sum(sums[name] for sums in others) for name in _FIELDS}
        table.append(_row(f"{len(others):,} others", "", None, summed, own))
    beyond = _volumes(change.get("beyond"))
    if beyond["area_m2"] > 0:
        table.append(_row("below no region", "ground that is gone", None, beyond, own))
    table.append(_row("all", "", None, _volumes(change.get("whole")), own))
    return ChangeFacts(tuple(table), has_map)


def change_span_m(change: ChangeMap) -> float:
    """Choose the ends of the ramp, plus and minus: 99 % of the changes lie within."""
    steps_m = np.abs(change.dz_m[_significant(change)])
    return float(np.percentile(steps_m, 99)) if len(steps_m) else 0.0


def change_colours(change: ChangeMap, mesh: Mesh, span_m: float) -> UInt8:
    """Colour faces by the change beneath their middles: red where it sank, blue where it rose.

    Parameters
    ----------
    change : ChangeMap
    mesh : Mesh
    span_m : float
        Differences from which the last colours are drawn.

    Returns
    -------
    ndarray of shape (F, 3), uint8
        Grey where the ground did not move beyond doubt, or the cell's height difference is within
        its level of detection.
    """
    x, z = (mesh.vertices[:, axis][mesh.faces].mean(axis=1) for axis in (0, 2))
    cells = change.cells_at(x, z)
    steps_m: Float32 = np.where(_significant(change), change.dz_m, np.nan).astype(np.float32)
    values = np.where(cells >= 0, steps_m.ravel()[cells], np.nan)
    colours = diverging_colours(values, span_m)
    colours[np.isnan(values)] = NO_VALUE
    return colours


def _significant(change: ChangeMap) -> Any:
    with np.errstate(invalid="ignore"):
        return change.counted & (np.abs(change.dz_m) > change.lod_m)


def _volumes(value: object) -> dict[str, float]:
    """Take volumes as regions.json has them; what is no number is 0."""
    values = value if isinstance(value, Mapping) else {}
    numbers = {name: values.get(name) for name in _FIELDS}
    return {
        name: float(number) if isinstance(number, int | float) else 0.0
        for name, number in numbers.items()
    }


def _row(
    name: str, label: str, region: int | None, sums: Mapping[str, float], unit: SurveyUnit
) -> dict[str, Any]:
    cut, fill, either = (
        sums[name] / unit.plan_m**3 for name in ("cut_m3", "fill_m3", "uncertainty_m3")
    )
    return {
        "name": name,
        "label": label,
        "region": region,
        "cut": f"{cut:,.1f}",
        "fill": f"{fill:,.1f}",
        "net": f"{round(fill - cut, 1) + 0.0:+,.1f}",
        "uncertainty": f"{either:,.1f}",
        "area": f"{sums['area_m2'] / unit.plan_m**2:,.0f}",
    }
