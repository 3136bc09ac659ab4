"""A scene from straight above: the picture, and what each pixel's ray met."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float32, Int32, UInt8
from terraport_pipeline.engines.cameras import Camera
from terraport_pipeline.engines.pictures import BAND_ROWS, render_mesh
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.published.scene_model import SceneModel
from terraport_pipeline.report.traced_rays import TracedRays

__all__ = ["Plan", "draw_plan"]

MARGIN: Final = 0.02
"""Ground beside the scene, of its longer side."""

ASPECTS: Final = (0.8, 1.45)
"""Narrowest and widest form of the picture: beside it stand figures."""

PAPER: Final = 255
"""Grey level where no ground is: a plan stands on paper, not in the sky."""

RELIEF: Final = 0.55
"""Photographed colours hold the light of the day already."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A picture from above, north up, and a raster of the surface that it shows."""

    image: UInt8
    """(height, width, 3) sRGB."""
    height_m: Float32
    """(rows, columns) y of the scene, NaN where no ground is; several cells a pixel."""
    region: Int32
    """(rows, columns) region met; -1 where none is."""
    cell_m: float
    """Side of a cell of the raster."""
    west_m: float
    """x of the scene at the picture's left."""
    north_m: float
    """z of the scene at its top (south is positive)."""

    @property
    def covered(self) -> Bool:
        """(rows, columns) where ground is."""
        ground: Bool = ~np.isnan(self.height_m)
        return ground

    @property
    def area_m2(self) -> float:
        """Plan area of the scene: ground seen from above."""
        return float(self.covered.sum()) * self.cell_m**2

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the picture on the ground."""
        rows, columns = self.height_m.shape
        return columns * self.cell_m, rows * self.cell_m


def draw_plan(model: SceneModel, rays: RayScene, pixels: int, supersample: int) -> Plan:
    """Draw a scene from above.

    Parameters
    ----------
    model : SceneModel
        Its detail is drawn, with its textures or the vertices' colours.
    rays : RayScene
        Of that detail.
    pixels : int
        Size of the picture; its form is the scene's.
    supersample : int
        Cells of the raster per pixel and axis.

    Returns
    -------
    Plan
        Rays are traced once, for picture and raster.
    """
    # (1) A camera over all segments; the picture's form within bounds that a page has room for.
    bounds = model.segment_bounds.astype(np.float64)
    low, high = bounds[:, :3].min(axis=0), bounds[:, 3:].max(axis=0)
    wide, deep = np.maximum((high - low)[[0, 2]], 1e-3)
    margin = MARGIN * max(wide, deep)
    wide, deep = wide + 2 * margin, deep + 2 * margin
    aspect = float(np.clip(wide / deep, *ASPECTS))
    height = max(1, round(np.sqrt(pixels / aspect)))
    width = max(1, round(height * aspect))
    half = max(deep, wide * height / width) / 2
    middle, rise = (low + high) / 2, max(float(high[1] - low[1]), 1.0)
    eye_y = float(np.float32(high[1] + rise))
    camera = Camera(
        "orthographic", (float(middle[0]), eye_y, float(middle[2])),
        (1, 0, 0), (0, 0, -1), (0, -1, 0), float(half),
    )  # fmt: skip
    # (2) The picture.
    traced = TracedRays(rays)
    detail = model.detail
    image = render_mesh(
        detail.vertices,
        detail.faces,
        camera,
        (width, height),
        colours=detail.colours,
        texturing=None if model.textures is None else model.textures.detail,
        normals=detail.normals,
        relief=RELIEF,
        supersample=supersample,
        scene=traced,
    )
    # (3) The raster: the same rays, asked for in the same bands, are not traced again.
    rows, columns = height * supersample, width * supersample
    heights = np.full(rows * columns, np.nan, np.float32)
    region = np.full(rows * columns, -1, np.int32)
    step = BAND_ROWS * supersample
    for first in range(0, rows, step):
        hits = traced.intersect(*camera.rays(columns, rows, slice(first, first + step)))
        band = slice(first * columns, (first + step) * columns)
        met = hits.face >= 0
        heights[band][met] = eye_y - hits.t[met]
        region[band][met] = model.region_of_face[hits.face[met]]
    cell_m = 2 * half / rows
    bare = np.isnan(heights).reshape(height, supersample, width, supersample).all(axis=(1, 3))
    image[bare] = PAPER
    return Plan(
        image,
        heights.reshape(rows, columns),
        region.reshape(rows, columns),
        float(cell_m),
        float(middle[0] - cell_m * columns / 2),
        float(middle[2] - half),
    )
