"""Pieces of real surveys with regions drawn by hand, and the whole surveys as meshes.

Each piece was drawn twice (``NAME_a.geojson``, ``NAME_b.geojson``; the survey's CRS), over pictures
of the cloud from above with a grid, before any engine had been run on it: pass a from a plain
picture; pass b from one that was turned by a quarter, brighter, smaller, and in the reverse order
of pieces, without looking at pass a. The same kind of drawer, a language model that reads pictures,
drew both, so their agreement says how well a line can be placed and not how far people differ in
what they call a region. Later rings lie over earlier ones; ``region: null`` leaves ground out.

Engines get the *whole* survey, thinned, as a plan triangulation: no reconstruction is needed, so
the truth does not depend on the project's own engine. It is read from ``../shared/data``; where a
survey is absent there is no mesh.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import laspy
import numpy as np
from scipy.spatial import Delaunay, cKDTree

from terraport_payload.types import AnyInt, Bool, Float32, Float64, Int32, UInt8
from terraport_research.plan_scores import PlanScore, drawn_regions, filled_gaps, plan_score

__all__ = ["CHOOSING", "PIECES", "REPORTING", "SHARED_DATA", "Piece", "SurveyMesh", "load_survey"]

SHARED_DATA: Final = Path(__file__).resolve().parents[5] / "shared" / "data"
CHOOSING: Final = ("apaxco_pit", "churo_fields", "red_rocks_cliffs", "caliterra_earthworks")
"""Parameters were chosen on these."""
REPORTING: Final = ("churo_river", "red_rocks_meadow", "brighton_park")
"""Nothing was chosen on these."""
PIECES: Final = CHOOSING + REPORTING
SPACING_M: Final = {
    "apaxco_quarry": 0.35, "brighton_beach": 0.25, "caliterra": 0.35, "churo_andes": 1.2,
    "red_rocks": 1.0,
}  # fmt: skip
"""Cells of which one point, the mean of those within, stays, by folder."""
_LONGEST_CELLS: Final = 6.0
"""Triangles with a longer edge, in cells, bridge gaps in the survey and are left out."""
_UNDRAWN: Final = 1_000_000
"""Region of what one drawing left out, where it is scored against the other."""
_GROUND_M: Final = 1.5
"""A cell of a piece is ground where the mesh has a face this near."""


@dataclass(frozen=True, slots=True, eq=False)
class SurveyMesh:
    """A whole survey, thinned."""

    vertices: Float32
    """(V, 3) metres, x east, y up, z south of ``origin``."""
    faces: Int32
    """(F, 3) seen from above counter-clockwise."""
    colours: UInt8
    """(V, 3) sRGB."""
    origin: Float64
    """(2,) east and north of the frame's origin, the survey's CRS."""

    def plan_middles(self) -> Float64:
        """Middle of every face, east and north, (F, 2)."""
        middles: Float64 = self.vertices[self.faces].mean(axis=1, dtype=np.float64)[:, [0, 2]]
        return middles * [1.0, -1.0] + self.origin


class Piece:
    """One piece, drawn twice."""

    def __init__(self, name: str) -> None:
        """Read the two drawings."""
        self.name = name
        self.drawings: list[dict[str, Any]] = [
            json.loads(
                (Path(__file__).parent / f"{name}_{which}.geojson").read_text(encoding="utf-8")
            )
            for which in "ab"
        ]

    @property
    def survey(self) -> str:
        """Path of the survey under the shared data."""
        return str(self.drawings[0]["survey"])

    @cached_property
    def rasters(self) -> tuple[Float64, list[Int32]]:
        """Middles of the cells, and the region of each in both drawings."""
        names: dict[str, int] = {}
        regions = []
        for drawing in self.drawings:
            features = drawing["features"]
            numbers = [
                -1 if name is None else names.setdefault(name, len(names))
                for name in (feature["properties"]["region"] for feature in features)
            ]
            rings = [np.array(f["geometry"]["coordinates"][0]) for f in features]
            middles, raster = drawn_regions(rings, numbers, drawing["box"])
            regions.append(raster)
        return middles, regions

    def nearest_faces(self, mesh: SurveyMesh) -> tuple[Bool, AnyInt]:
        """Say where the piece has ground, and the face nearest to every cell."""
        middles = self.rasters[0]
        distance, nearest = cKDTree(mesh.plan_middles()).query(middles.reshape(-1, 2))
        return (distance < _GROUND_M).reshape(middles.shape[:2]), nearest

    def scores(self, labels: AnyInt, ground: Bool, nearest: AnyInt) -> list[PlanScore]:
        """Score regions of the survey's faces against both drawings."""
        found = labels[nearest].reshape(ground.shape)
        return [plan_score(drawn, found, ground) for drawn in self.rasters[1]]

    def human_scores(self, ground: Bool) -> list[PlanScore]:
        """Score each drawing against the other; 1 - RI on ground that both drew."""
        first, second = self.rasters[1]
        both = ground & (first >= 0) & (second >= 0)
        scores = []
        for drawn, other in ((first, second), (second, first)):
            found = filled_gaps(np.where(ground, other, -1), ground)
            borders = plan_score(drawn, np.where(found < 0, _UNDRAWN, found), ground)
            common = plan_score(drawn, other, both)
            scores.append(replace(borders, rand_error=common.rand_error))
        return scores


def load_survey(path: str, data: Path = SHARED_DATA) -> SurveyMesh | None:
    """Read a survey by its path under the shared data; None where it is absent."""
    if not (data / path).exists():
        return None
    cell = SPACING_M[path.partition("/")[0]]
    cloud = laspy.read(data / path)
    places = np.stack([np.asarray(axis) for axis in (cloud.x, cloud.y, cloud.z)], axis=1)
    low = np.floor(places.min(axis=0))
    places -= low
    colours = np.stack([cloud.red, cloud.green, cloud.blue], axis=1).astype(np.float64)
    if colours.max() > 255:
        colours = np.floor(colours / 256)
    column, row = np.floor(places[:, :2] / cell).astype(np.int64).T
    _, owner = np.unique(row * 2**24 + column, return_inverse=True)
    number = np.bincount(owner)
    mean = np.stack([np.bincount(owner, v) / number for v in (*places.T, *colours.T)], axis=1)
    faces = Delaunay(mean[:, :2]).simplices.astype(np.int32)
    corners = mean[:, :2][faces]
    longest = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max(axis=1)
    return SurveyMesh(
        np.stack([mean[:, 0], mean[:, 2], -mean[:, 1]], axis=1).astype(np.float32),
        faces[longest < _LONGEST_CELLS * cell],
        np.rint(mean[:, 3:]).astype(np.uint8),
        low[:2],
    )
