"""Fitting primitives: faces united while the union is near a plane, a sphere or a cylinder.

Every face begins as a part. In turns the two neighbouring parts are united whose union a primitive
fits with the least error: the square of the distance, over the area.

References
----------
M. Attene, B. Falcidieno, M. Spagnuolo, "Hierarchical mesh segmentation based on fitting
primitives", The Visual Computer 22(3), 2006.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Int32
from terraport_pipeline.geometry.graph.merge_heap import unite_units
from terraport_pipeline.geometry.regions.pool_refine import number_by_first
from terraport_research.cutters.contract import Body, Cut, Cutter
from terraport_research.kernels.face_clusters import unite_by_fit
from terraport_research.kernels.primitive_fits import part_sums

__all__ = ["FITTING_PRIMITIVES"]


def _prepare(body: Body) -> Cut:
    n = len(body.faces)
    # About the middle and with an area of 1: sums of fourth powers lose what is far from 0.
    scale = np.sqrt(max(float(body.area.sum()), 1e-300))
    middle = (body.vertices.min(axis=0) + body.vertices.max(axis=0)) / 2
    corners = ((body.vertices - middle) / scale)[body.faces]
    sums = part_sums(corners, body.area / scale**2, body.normals)
    unions = unite_by_fit(np.ascontiguousarray(body.neighbours[0]), sums)

    def cut(k: int) -> Int32:
        part_of = np.arange(n, dtype=np.int32)
        unite_units(unions[: max(n - k, 0)], part_of)
        return number_by_first(part_of)[0]

    return cut


FITTING_PRIMITIVES: Final = Cutter(
    "fitting-primitives",
    "Fitting Primitives",
    "Attene, Falcidieno, Spagnuolo 2006",
    takes_k=True,
    prepare=_prepare,
    thesis="FP",
    departs="Spheres and cylinders are fitted algebraically, from the moments of a part.",
)
