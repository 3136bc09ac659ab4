"""What a surveyor asks of a scene first: where, how exact, how dense, how large, any warnings.

Page and PDF say the same words; both take them from here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy import ndimage

from terraport_payload.types import AnyFloat, Float32
from terraport_pipeline.engines.palettes import distinct_colours
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.geometry.photos.view_cover import cover_points
from terraport_pipeline.model import Mesh
from terraport_pipeline.region_table import region_rows
from terraport_pipeline.report.accuracy import PERCENTILES, REACH_SPACINGS, Accuracy
from terraport_pipeline.report.facts import points_note
from terraport_pipeline.report.plan_sheet import PlanSheet, plan_sheet
from terraport_pipeline.report.plan_view import Plan
from terraport_pipeline.report.scene_colour import SceneColour
from terraport_pipeline.report.survey_crs import crs_line
from terraport_pipeline.report.survey_units import SurveyUnit
from terraport_store import (
    DamagedSceneError,
    Manifest,
    RegionNames,
    Scene,
    read_labels,
)

__all__ = [
    "ACCURACY_UNKNOWN",
    "Figure",
    "Overlap",
    "RegionLine",
    "SurveyorFacts",
    "accuracy_figures",
    "photo_overlap",
    "surveyor_facts",
]

MAX_REGIONS: Final = 20
"""Largest regions that have volumes and rows."""

FAR_SHARE: Final = 0.01
"""Share of points far from the mesh from which it is worth a warning."""

OVERLAP_POINTS: Final = 20_000

LOOSE_SHARE: Final = 0.03
"""Share of a volume above which the parts that may not be material are reported."""

MAX_LOOSE: Final = 5
"""Maximum number of such regions in the report."""

ACCURACY_UNKNOWN: Final = (
    "Unknown: the survey's points are not at hand. They are in the build's work directory; "
    "terraport report SCENE --work DIR looks for them there, --survey FILE reads them again."
)

VOLUME_NOTE: Final = (
    "Numbers are on the plan. Plan area: ground of which the region is the highest surface. "
    "Volumes are between the highest surface and the one triangulated between points around the "
    "region (its toe; inner borders too). ±: half the 95 % interval by noise and spacing of the "
    "points and the placement of the toe; none where the noise is not known."
)

_COLOUR: Final = {
    "photos": "from the photos",
    "points": "from the points",
    "mesh": "from the images of the mesh",
    None: "none: grey",
}


@dataclass(frozen=True, slots=True)
class Figure:
    """A number with its name."""

    label: str
    value: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class RegionLine:
    """What the first table says of a region; "" where it is not known."""

    name: str
    """Number, and label where there is one."""
    number: str
    """Stable id."""
    colour: str
    """Of the picture of regions, ``#rrggbb``."""
    plan_area: str
    surface_area: str
    slope: str
    heights: str
    above: str
    below: str
    place: tuple[float, float] | None = None
    """Where its number stands on the plan: shares of width and height."""


@dataclass(frozen=True, slots=True)
class Overlap:
    """How many photos show a place of the ground, things in between not counted."""

    photos: int
    median: float
    p5: float


@dataclass(frozen=True, slots=True)
class SurveyorFacts:
    """The first screen in words and numbers."""

    name: str
    crs: str
    has_crs: bool
    units: str
    published: str
    """Day of the publication, UTC."""
    version: str
    terraport: str
    extent: str
    sheet: PlanSheet
    accuracy: tuple[Figure, ...]
    """Empty where it is not known."""
    accuracy_note: str
    map_top: str
    """Distance at the end of the map's ramp; "" where there is no map."""
    groups: tuple[tuple[str, tuple[Figure, ...]], ...]
    regions: tuple[RegionLine, ...]
    region_units: tuple[str, str, str]
    """Units of areas, volumes, heights."""
    region_total: int
    """Regions of the scene; ``regions`` are the largest of them."""
    regions_note: str
    change: tuple[Figure, ...]
    """Of the last survey; empty for a first one."""
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    """What the build chose, for those who run it."""

    def regions_line(self, rows: int) -> str:
        """Write what stands below a table of the largest regions, of as many rows at most."""
        shown = min(rows, len(self.regions))
        cut = shown < self.region_total and shown > 0
        return self.regions_note + (
            f" The {shown} largest of {self.region_total:,} regions." if cut else ""
        )


def surveyor_facts(
    scene: Scene,
    record: Mapping[str, Any],
    plan: Plan,
    detail: Mesh,
    accuracy: Accuracy | None,
    *,
    spacing_m: float = 0.0,
    overlap: Overlap | None = None,
    map_top_m: float | None = None,
) -> SurveyorFacts:
    """Gather what the first screen says.

    Parameters
    ----------
    scene : Scene
        Open.
    record : mapping
        Contents of build.json; may be empty.
    plan : Plan
    detail : Mesh
        As it was drawn: of a scene larger than memory thinned.
    accuracy : Accuracy or None
        None where the survey's points are not at hand.
    spacing_m : float
        Spacing of the survey's points, where they are at hand.
    overlap : Overlap or None
    map_top_m : float or None
        Distance at the end of the accuracy map's ramp.
    """
    manifest = scene.manifest
    unit = SurveyUnit.of(manifest)
    # (1) Where: CRS, corners, size.
    crs, has_crs = crs_line(manifest)
    east, north, _ = manifest.origin
    wide_m, deep_m = plan.size_m
    sheet = plan_sheet(east + plan.west_m, north - plan.north_m, wide_m, deep_m, unit)
    low, high = _box(scene)
    size = high - low
    # (2) Regions: areas and volumes of the build.
    regions, region_total, regions_note, loose = _regions(scene, plan)
    # (3) Figures, and what to look out for.
    known = [] if accuracy is None else accuracy_figures(accuracy, unit)
    return SurveyorFacts(
        name=manifest.name,
        crs=crs,
        has_crs=has_crs,
        units=unit.full_name,
        published=_published(scene.path),
        version=manifest.version[:12],
        terraport=manifest.build.terraport,
        extent=f"{unit.length(size[0])} east-west x {unit.length(size[2])} north-south",
        sheet=sheet,
        accuracy=tuple(known),
        accuracy_note=_accuracy_note(accuracy),
        map_top="" if map_top_m is None else unit.length(map_top_m),
        groups=(
            ("Survey", _survey_figures(manifest, record, plan, unit, overlap)),
            ("Ground", _ground_figures(scene, plan, detail, unit)),
        ),
        regions=regions,
        region_units=(f"{unit.name}²", unit.volume_name, unit.height_name),
        region_total=region_total,
        regions_note=regions_note,
        change=_change(scene.regions, unit),
        warnings=(
            *_own_warnings(manifest, accuracy, spacing_m, unit, has_crs=has_crs),
            *loose,
            *manifest.build.warnings,
        ),
        notes=manifest.build.choices,
    )


def accuracy_figures(accuracy: Accuracy, unit: SurveyUnit) -> list[Figure]:
    """Tabulate distances from the survey's points to the mesh."""
    figures = [
        Figure(f"{percent} % of points within", unit.length(accuracy.percentile_m(percent)))
        for percent in PERCENTILES
    ]
    bias = accuracy.bias_m
    side = "mesh above the points" if bias > 0 else "mesh below the points"
    return [
        *figures,
        Figure("largest", unit.length(accuracy.largest_m), "outliers with it"),
        Figure("root mean square", unit.length(accuracy.rms_m), "outliers with it"),
        Figure("bias", f"{'+' if bias > 0 else ''}{unit.length(bias)}", f"signed mean: {side}"),
    ]


def photo_overlap(views: Sequence[View], detail: Mesh) -> Overlap | None:
    """Count the photos that show places of the ground; None where none does."""
    step = max(1, len(detail.vertices) // OVERLAP_POINTS)
    photos, _, _ = cover_points(views, detail.vertices[::step])
    seen = photos[photos > 0]
    if not len(seen):
        return None
    return Overlap(len(views), float(np.median(seen)), float(np.percentile(seen, 5)))


def _accuracy_note(accuracy: Accuracy | None) -> str:
    if accuracy is None:
        return ACCURACY_UNKNOWN
    measured, total = len(accuracy.points), accuracy.total
    of = "all" if measured >= total else f"{measured:,} of"
    return (
        f"Shortest distance from the survey's points to the mesh, at {of} {total:,} points: how "
        "well the mesh follows the points. How exact these are, check points tell."
    )


def _survey_figures(
    manifest: Manifest,
    record: Mapping[str, Any],
    plan: Plan,
    unit: SurveyUnit,
    overlap: Overlap | None,
) -> tuple[Figure, ...]:
    points = manifest.counts.points
    area = plan.area_m2
    figures = [Figure("points", f"{points:,}", points_note(manifest))]
    if area > 0 and points:
        density = points / area
        figures += [
            Figure("density", unit.density(density), "points over plan area"),
            Figure("point spacing", unit.length(density**-0.5), "mean, 1/√density"),
        ]
    figures.append(Figure("colour", _COLOUR[SceneColour.of(manifest).source]))
    textures = manifest.textures
    if textures is not None and textures.source == "photos":
        if textures.gsd_m is not None:
            figures.append(Figure("GSD of the photos", unit.length(textures.gsd_m), "median"))
        if overlap is not None:
            figures.append(
                Figure(
                    "photo overlap",
                    f"{overlap.median:.0f} photos",
                    f"median of a place; 95 % of places {overlap.p5:.0f} or more; "
                    f"{overlap.photos:,} photos",
                )
            )
        unseen = _texture_count(record, "unseen_share")
        if unseen is not None:
            figures.append(Figure("surface in no photo", f"{unseen:.1%}"))
    return tuple(figures)


def _ground_figures(scene: Scene, plan: Plan, detail: Mesh, unit: SurveyUnit) -> tuple[Figure, ...]:
    manifest = scene.manifest
    low, high = _box(scene)
    surface = _surface_area_m2(scene, detail)
    heights = (
        unit.height(manifest.origin[2] + low[1]),
        unit.height(manifest.origin[2] + high[1]),
    )
    return (
        Figure("plan area", unit.area(plan.area_m2), "seen from above"),
        *(() if surface is None else (Figure("surface area", unit.area(surface), "of the mesh"),)),
        Figure(
            "size",
            f"{unit.length(high[0] - low[0])} x {unit.length(high[2] - low[2])}",
            "east x north",
        ),
        Figure("heights", f"{heights[0]} to {heights[1]} {unit.height_name}"),
    )


def _box(scene: Scene) -> tuple[Float32, Float32]:
    """Least and greatest corner of the ground; the manifest's box holds the wider base, too."""
    bounds = scene.index.bounds
    return bounds[:, :3].min(axis=0), bounds[:, 3:].max(axis=0)


def _surface_area_m2(scene: Scene, detail: Mesh) -> float | None:
    """Sum up the regions' areas; of a scene without any the mesh's, where that is whole."""
    rows = scene.regions.get("regions", [])
    stated = [row.get("area_m2") for row in rows if isinstance(row, Mapping)]
    areas = [float(area) for area in stated if isinstance(area, int | float)]
    if areas and len(areas) == len(rows):
        return sum(areas)
    if len(detail.faces) < scene.manifest.counts.detail_faces:
        return None
    corners = detail.vertices[detail.faces].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(across, axis=1).sum() / 2.0)


def _regions(scene: Scene, plan: Plan) -> tuple[tuple[RegionLine, ...], int, str, tuple[str, ...]]:
    """Tabulate the largest regions, largest first; how many there are; what to know of them."""
    try:
        names = RegionNames.of(scene.regions, file=scene.manifest.files["regions.json"].path)
    except DamagedSceneError as error:
        return (), 0, str(error), ()
    problem = ""
    try:
        names = names.with_labels(read_labels(scene.path))
    except DamagedSceneError as error:
        problem = f" Labels are left out: {error}."
    rows = region_rows(names, scene.regions, scene.manifest.origin)
    if not rows:
        return (), 0, f"The scene has no regions.{problem}", ()
    seen = np.bincount(plan.region[plan.region >= 0], minlength=len(rows)) * plan.cell_m**2
    if not any(row["surface_area_m2"] for row in rows):
        rows.sort(key=lambda row: (-float(seen[row["region"]]), row["region"]))
    shown = rows[:MAX_REGIONS]
    boxes = ndimage.find_objects(plan.region + 1)
    colours = distinct_colours(len(rows))
    lines = tuple(
        _region_line(row, colours[row["region"]], boxes, scene, plan, seen) for row in shown
    )
    return lines, len(rows), f"{VOLUME_NOTE}{problem}", _loose_parts(rows, scene)


def _loose_parts(rows: Sequence[Mapping[str, Any]], scene: Scene) -> tuple[str, ...]:
    """List the regions with parts of their volume that may not be material."""
    unit, found = SurveyUnit.of(scene.manifest), []
    for row in rows:
        above_m3, below_m3 = row["above_toe_m3"], row["below_toe_m3"]
        if above_m3 is None or below_m3 is None or above_m3 <= below_m3:
            continue
        least_m3 = max(LOOSE_SHARE * above_m3, (row["toe_uncertainty_m3"] or 0.0) / 2)
        for key, what in (
            ("objects_m3", "may be trees, machines or walls (flanks steeper than 45°)"),
            ("overhang_m3", "is empty space under overhangs"),
        ):
            part_m3 = min(row[key] or 0.0, above_m3)
            if part_m3 > least_m3:
                text = (
                    f"{_name(row)}: up to {unit.volume(part_m3)} ({part_m3 / above_m3:.0%}) of "
                    f"the {unit.volume(above_m3)} above its toe {what}; "
                    f"{unit.volume(above_m3 - part_m3)} without."
                )
                found.append((part_m3, text))
    found.sort(key=lambda pair: -pair[0])
    return tuple(text for _, text in found[:MAX_LOOSE])


def _name(row: Mapping[str, Any]) -> str:
    number = row["region"] if row["stable_id"] is None else row["stable_id"]
    return f"{number} · {row['label']}" if row["label"] else f"region {number}"


def _middle(plan: Plan, number: int, box: tuple[slice, slice] | None) -> tuple[float, float] | None:
    """Find the point furthest from a region's border, as shares of width and height."""
    if box is None:
        return None
    depth = ndimage.distance_transform_edt(np.pad(plan.region[box] == number, 1))[1:-1, 1:-1]
    row, column = np.unravel_index(int(depth.argmax()), depth.shape)
    rows, columns = plan.region.shape
    return (
        (box[1].start + float(column) + 0.5) / columns,
        (box[0].start + float(row) + 0.5) / rows,
    )


def _with_uncertainty(value_m3: float | None, row: Mapping[str, Any], unit: SurveyUnit) -> str:
    if value_m3 is None:
        return ""
    either = row["toe_uncertainty_m3"]
    text = unit.volume_value(value_m3)
    return text if either is None else f"{text} ± {unit.volume_value(either)}"


def _region_line(
    row: Mapping[str, Any],
    colour: Any,
    boxes: Sequence[tuple[slice, slice] | None],
    scene: Scene,
    plan: Plan,
    seen_m2: AnyFloat,
) -> RegionLine:
    unit = SurveyUnit.of(scene.manifest)
    region, plan_m2 = row["region"], row["plan_area_m2"]
    plan_m2 = float(seen_m2[region]) if plan_m2 is None else plan_m2
    number = str(row["region"] if row["stable_id"] is None else row["stable_id"])
    low, high = row["lowest_m"], row["highest_m"]
    red, green, blue = (int(level) for level in colour)
    return RegionLine(
        name=_name(row),
        number=number,
        colour=f"#{red:02x}{green:02x}{blue:02x}",
        plan_area=unit.area_value(plan_m2),
        surface_area=""
        if row["surface_area_m2"] is None
        else unit.area_value(row["surface_area_m2"]),
        slope="" if row["slope_deg"] is None else f"{row['slope_deg']:.0f}°",
        heights=(
            "" if low is None or high is None else f"{unit.height(low)} to {unit.height(high)}"
        ),
        above=_with_uncertainty(row["above_toe_m3"], row, unit),
        below=_with_uncertainty(row["below_toe_m3"], row, unit),
        place=_middle(plan, region, boxes[region] if region < len(boxes) else None),
    )


def _change(document: Mapping[str, Any], unit: SurveyUnit) -> tuple[Figure, ...]:
    """Sum up what the last survey changed; nothing for a first one."""
    change = document.get("change")
    whole = change.get("whole") if isinstance(change, Mapping) else None
    if not isinstance(whole, Mapping):
        return ()

    def value(name: str) -> float:
        number = whole.get(name)
        return float(number) if isinstance(number, int | float) else 0.0

    either = f"± {unit.volume(value('uncertainty_m3'))}"
    return (
        Figure("cut", unit.volume(value("cut_m3")), either),
        Figure("fill", unit.volume(value("fill_m3")), either),
        Figure("moved plan area", unit.area(value("area_m2"))),
    )


def _own_warnings(
    manifest: Manifest,
    accuracy: Accuracy | None,
    spacing_m: float,
    unit: SurveyUnit,
    *,
    has_crs: bool,
) -> list[str]:
    """Say what a surveyor must look out for, and the build does not say."""
    texts = []
    if SceneColour.of(manifest).source is None:
        texts.append("The survey has no colours, and there are no photos: the scene is grey.")
    if not has_crs:
        texts.append(
            "No coordinate reference system is stated: coordinates and units are taken as metres. "
            "Build with --crs EPSG:n (and --units where they are feet)."
        )
    far_m = REACH_SPACINGS * spacing_m
    if accuracy is not None and far_m > 0:
        share = accuracy.share_beyond(far_m)
        if share > FAR_SHARE:
            texts.append(
                f"{share:.1%} of the points lie more than {unit.length(far_m)} from the mesh: "
                "noise, vegetation, or ground that the mesh leaves out. The map shows where."
            )
    return texts


def _texture_count(record: Mapping[str, Any], name: str) -> float | None:
    for row in record.get("stages", []):
        if isinstance(row, Mapping) and row.get("name") == "texture":
            counts = row.get("counts")
            value = counts.get(name) if isinstance(counts, Mapping) else None
            if isinstance(value, int | float) and not isinstance(value, bool):
                return float(value)
    return None


def _published(scene_path: Path) -> str:
    """Day on which the manifest was put in its place."""
    written = (scene_path / "scene.json").stat().st_mtime
    return datetime.fromtimestamp(written, tz=UTC).strftime("%Y-%m-%d")
