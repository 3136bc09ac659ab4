"""The double threshold: neighbours alike in colour and in direction are of one segment.

Every face begins as a segment of its own, at its middle, in the mean colour of its corners and with
its normal. Those of two faces that are among each other's eight nearest are united where the colour
differs less than one threshold (Euclidean in RGB) and the normal less than the other. Nothing joins
what stays small: that is the method.

References
----------
J. Strom, A. Richardson, E. Olson, "Graph-based segmentation for colored 3D laser point clouds",
IROS 2010; as the thesis describes it, section 2.6.3.3 (its [53]), with thresholds that do not adapt
to a segment.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Int32
from terraport_pipeline.geometry.mesh.adjacency import components
from terraport_research.cutters.contract import Body, Cut, Cutter

__all__ = ["DOUBLE_THRESHOLD"]

_NEIGHBOURS: Final = 8
_COLOUR_DIFFERENCE: Final = 8.0
"""Of 255 levels."""
_TURN_DEG: Final = 30.0
"""Both chosen on the procedural quarries that the engines were tuned on."""


def _prepare(body: Body) -> Cut:
    colours, normals = body.face_colours, body.normals
    pairs = body.nearest_faces(_NEIGHBOURS)
    step = colours[pairs[:, 0]] - colours[pairs[:, 1]]
    alike = (step * step).sum(axis=1) < _COLOUR_DIFFERENCE**2
    cosine = (normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1)
    alike &= cosine > np.cos(np.deg2rad(_TURN_DEG))
    labels, _ = components(len(colours), pairs[alike])

    def cut(k: int) -> Int32:  # noqa: ARG001  finds the number itself
        return labels

    return cut


DOUBLE_THRESHOLD: Final = Cutter(
    "double-threshold",
    "Double threshold",
    "Strom, Richardson, Olson 2010",
    takes_k=False,
    prepare=_prepare,
    departs="Faces for points; thresholds do not adapt to a segment, as the thesis describes it.",
)
