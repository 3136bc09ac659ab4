"""The regions of a scene as outlines seen from above, with what is known of each."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from ezdxf.enums import TextEntityAlignment

from terraport_pipeline.errors import OptionError
from terraport_pipeline.export.dxf import new_drawing, save_drawing
from terraport_pipeline.export.frame import SurveyFrame
from terraport_pipeline.export.selection import SelectedScene
from terraport_pipeline.export.vector_file import write_shapes
from terraport_pipeline.geometry.regions.region_outlines import outline_edges, times_around
from terraport_pipeline.progress import Progress
from terraport_pipeline.published.ground import Ground, read_ground
from terraport_pipeline.region_table import region_rows

__all__ = ["region_shapes", "write_region_shapes"]

_PROPERTIES: Final = {
    "stable_id": "region", "label": "name", "class": "class", "confidence": "confidence",
    "plan_area_m2": "plan_area_m2", "surface_area_m2": "surface_area_m2",
    "above_toe_m3": "above_toe_m3", "below_toe_m3": "below_toe_m3",
    "toe_uncertainty_m3": "toe_uncertainty_m3", "objects_m3": "objects_m3",
    "overhang_m3": "overhang_m3", "cut_m3": "cut_m3", "fill_m3": "fill_m3",
    "change_uncertainty_m3": "change_uncertainty_m3", "mean_colour": "colour",
    "slope_deg": "slope_deg", "roughness_m": "rough_m", "lowest_m": "lowest_m",
    "highest_m": "highest_m",
}  # fmt: skip
"""Names of the written properties, by the names in the table of regions."""

_SHORT: Final = {
    "plan_area_m2": "plan_m2", "surface_area_m2": "surface_m2", "above_toe_m3": "above_m3",
    "below_toe_m3": "below_m3", "toe_uncertainty_m3": "toe_unc_m3", "overhang_m3": "overh_m3",
    "change_uncertainty_m3": "chg_unc_m3",
}  # fmt: skip
"""Names in a Shapefile, which allows ten characters."""

_NO_LAYER_NAME: Final = re.compile(r'[<>/\\":;?*|=`,\x00-\x1f]')
"""What CAD programs refuse in the name of a layer."""

_MAX_LAYER_NAME: Final = 255


def write_region_shapes(path: Path, selected: SelectedScene, progress: Progress) -> dict[str, Any]:
    """Write the outlines of regions as GeoJSON, GeoPackage, Shapefile or DXF.

    Parameters
    ----------
    path : Path
        Ends with .geojson, .gpkg, .shp or .dxf.
    selected : SelectedScene
        Its regions, all or some; an extent cuts the outlines.
    progress : Progress

    Returns
    -------
    dict
        What to say of it.

    Raises
    ------
    OptionError
        No region is left, or the format cannot name the survey's CRS.
    LabelError, ResourceError
        The scene gives no stable ids, or is too large.
    """
    scene, frame, selection = selected.scene, selected.frame, selected.selection
    ground = read_ground(scene, progress)
    wanted = selection.regions
    shapes, cut = region_shapes(ground, frame, progress, wanted), 0
    if selection.extent is not None:
        box = shapely.box(*selection.extent.values)
        whole = shapes
        shapes = {number: _areas(shape.intersection(box)) for number, shape in whole.items()}
        cut = sum(
            not shape.is_empty and shape.area < whole[number].area * (1.0 - 1e-9)
            for number, shape in shapes.items()
        )
    rows = region_rows(ground.names, ground.document, scene.manifest.origin)
    kept = [row for row in rows if not shapes.get(row["region"], shapely.MultiPolygon()).is_empty]
    if not kept:
        raise OptionError("no region with an area seen from above; expected a larger --extent")
    outlines = [shapes[row["region"]] for row in kept]
    if path.suffix.lower() == ".dxf":
        _write_drawing(path, kept, outlines, frame)
    else:
        columns = {
            _SHORT.get(title, title) if path.suffix.lower() == ".shp" else title: [
                row.get(key) if row.get(key) != "" else None for row in kept
            ]
            for key, title in _PROPERTIES.items()
            if any(row.get(key) not in (None, "") for row in kept) or key == "label"
        }
        write_shapes(path, "regions", "MultiPolygon", outlines, columns, frame)
    named = sum(bool(row["label"]) for row in kept)
    said = {"regions": f"{len(kept):,}", "with a name": f"{named:,}"}
    if cut:
        said["cut by the extent"] = f"{cut:,}; their areas and volumes are of the whole regions"
    return said


def region_shapes(
    ground: Ground, frame: SurveyFrame, progress: Progress, wanted: frozenset[int] | None = None
) -> dict[int, Any]:
    """Draw the outline of every region as seen from above.

    Parameters
    ----------
    ground : Ground
    frame : SurveyFrame
    progress : Progress
        A step of regions.
    wanted : frozenset of int, optional
        Only these regions.

    Returns
    -------
    dict of int to shapely MultiPolygon
        Outlines by region, in plan coordinates, exactly along the triangles' edges: the centre of
        a face of ground that does not overhang is in the outline of its own region only. Overhangs
        are resolved by the winding number. Empty for a region that is vertical throughout.
    """
    edges, of_region = outline_edges(ground.mesh.faces, ground.region_of_face)
    places = frame.to_plan(ground.mesh.vertices)[:, :2]
    count = len(ground.document["regions"])
    starts = np.searchsorted(of_region, np.arange(count + 1))
    shapes = {}
    progress.start("outlines", float(count), "regions")
    for number in range(count):
        if wanted is None or number in wanted:
            ends = places[edges[starts[number] : starts[number + 1]]]
            # Edges that meet in plan alone (overhangs) are cut where they cross.
            lines = shapely.union_all(shapely.linestrings(ends))
            parts = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
            within = shapely.get_coordinates(shapely.point_on_surface(parts))
            inside = times_around(within, ends[:, 0].copy(), ends[:, 1].copy()) != 0
            shapes[number] = _areas(shapely.union_all(parts[inside]))
        progress.advance(1)
    progress.done({})
    return shapes


def _areas(shape: Any) -> Any:
    """Keep the polygons of a shape, as one."""
    parts = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    inner = [p for part in parts for p in shapely.get_parts(part)]
    return shapely.MultiPolygon([part for part in inner if part.area > 0.0])


def _write_drawing(
    path: Path, rows: Sequence[dict[str, Any]], shapes: Sequence[Any], frame: SurveyFrame
) -> None:
    """Write hatches, which know holes, on a layer for every name."""
    drawing = new_drawing(frame)
    space = drawing.modelspace()
    for row, plan_shape in zip(rows, shapes, strict=True):
        shape = frame.shape_to_survey(plan_shape)
        name = row["label"] or f"region {row['stable_id']}"
        layer = _NO_LAYER_NAME.sub("_", name)[:_MAX_LAYER_NAME]
        colour = row["mean_colour"] or "#969696"
        rgb = (int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16))
        if layer not in drawing.layers:
            drawing.layers.add(layer, true_color=rgb[0] << 16 | rgb[1] << 8 | rgb[2])
        hatch = space.add_hatch(dxfattribs={"layer": layer})
        hatch.rgb = rgb
        for part in shape.geoms:
            hatch.paths.add_polyline_path(list(part.exterior.coords)[:-1], is_closed=True, flags=1)
            for hole in part.interiors:
                hatch.paths.add_polyline_path(list(hole.coords)[:-1], is_closed=True, flags=16)
        inside = shape.representative_point()
        text = space.add_text(name, height=1.0, dxfattribs={"layer": layer})
        text.set_placement((inside.x, inside.y), align=TextEntityAlignment.MIDDLE_CENTER)
    save_drawing(drawing, path)
