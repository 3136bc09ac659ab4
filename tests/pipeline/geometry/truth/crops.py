"""Pieces of real surveys with regions drawn by hand, as meshes with a truth per face.

The polygons were drawn over top-down pictures of the clouds, in the survey's own coordinates
(``*.geojson``). They enclose what a person would call one thing, a metre or so inside its edge;
what lies between them, and what nobody could place (a gradient, rubble), has no truth and is not
scored. The survey is read from ``../shared/data``; where it is absent there is no mesh.

The mesh is the plan triangulation of the points, thinned to one per cell: no reconstruction is
needed, so the truth does not depend on the project's own engine.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import laspy
import numpy as np
from scipy.spatial import Delaunay

from terraport_payload.types import Bool, Float32, Float64, Int32, UInt8

__all__ = ["CROPS", "SHARED_DATA", "TruthCrop", "inside_polygon", "load_crop"]

SHARED_DATA: Final = Path(__file__).resolve().parents[5] / "shared" / "data"
CROPS: Final = ("apaxco_quarry", "red_rocks", "churo_andes")
_FACES: Final = 150_000
"""About this many faces per piece."""
_LONGEST_CELLS: Final = 6.0
"""Triangles with a longer edge, in cells, bridge gaps in the survey and are left out."""


@dataclass(frozen=True, slots=True, eq=False)
class TruthCrop:
    """A piece of a survey."""

    vertices: Float32
    """(V, 3) metres, x east, y up, z south of the box's corner."""
    faces: Int32
    """(F, 3) vertex indices, seen from above counter-clockwise."""
    colours: UInt8
    """(V, 3) sRGB as photographed."""
    truth: Int32
    """(F,) number of the region in ``names``; -1 without truth."""
    names: tuple[str, ...]
    """Regions in the file's order."""


def load_crop(name: str, data: Path = SHARED_DATA) -> TruthCrop | None:
    """Read the piece ``name`` of :data:`CROPS`; None where its survey is absent."""
    drawn = json.loads((Path(__file__).parent / f"{name}.geojson").read_text(encoding="utf-8"))
    survey = data / drawn["survey"]
    if not survey.exists():
        return None
    west, south, east, north = drawn["box"]
    cloud = laspy.read(survey)
    x, y, z = (np.asarray(axis) for axis in (cloud.x, cloud.y, cloud.z))
    kept = np.flatnonzero((x >= west) & (x < east) & (y >= south) & (y < north))
    colours = np.stack([cloud.red, cloud.green, cloud.blue], axis=1)[kept]
    if colours.max() > 255:
        colours = colours // 256
    # A plan triangulation has two faces per point: one point per cell gives the faces asked for.
    cell = float(np.sqrt((east - west) * (north - south) / (_FACES / 2)))
    plan = np.stack([x[kept] - west, y[kept] - south], axis=1)
    column, row = np.floor(plan / cell).astype(np.int64).T
    _, first = np.unique(row * 2**20 + column, return_index=True)
    plan, height, colours = plan[first], z[kept][first] - z[kept].min(), colours[first]
    faces = Delaunay(plan).simplices.astype(np.int32)
    corners = plan[faces]
    edges = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2)
    corners, faces = (
        array[edges.max(axis=1) < _LONGEST_CELLS * cell] for array in (corners, faces)
    )
    middles = corners.mean(axis=1) + np.array([west, south])
    truth = np.full(len(faces), -1, np.int32)
    for number, feature in enumerate(drawn["features"]):
        ring = np.array(feature["geometry"]["coordinates"][0])
        truth[inside_polygon(middles, ring)] = number
    return TruthCrop(
        np.stack([plan[:, 0], height, -plan[:, 1]], axis=1).astype(np.float32),
        faces,
        np.ascontiguousarray(colours.astype(np.uint8)),
        truth,
        tuple(feature["properties"]["region"] for feature in drawn["features"]),
    )


def inside_polygon(points: Float64, ring: Float64) -> Bool:
    """Say which points lie inside a closed ring, by the even-odd rule."""
    inside = np.zeros(len(points), np.bool_)
    x, y = points.T
    for (x0, y0), (x1, y1) in pairwise(ring):
        if y0 == y1:
            continue
        crosses = (y0 > y) != (y1 > y)
        inside ^= crosses & (x < (x1 - x0) * (y - y0) / (y1 - y0) + x0)
    return inside
