"""The thesis's Triangle Pool Algorithm on shape diameters (section 5.4.2)."""

from __future__ import annotations

from typing import Final

from terraport_payload.types import Int32
from terraport_pipeline.geometry.regions.engine_options import TrianglePoolOptions
from terraport_pipeline.geometry.regions.shape_index import shape_index
from terraport_pipeline.geometry.regions.triangle_pool import triangle_pools
from terraport_research.cutters.contract import Body, Cut, Cutter

__all__ = ["TPA"]

_POOLS: Final = TrianglePoolOptions(attribute_range=2.0)
"""Th .7 and sTh .015 as published. The thesis does not say how the shape diameter is scaled; to 0
to 2 gives its row."""


def _prepare(body: Body) -> Cut:
    pairs = body.neighbours[0]
    index = shape_index(body.thickness, pairs)
    pools = triangle_pools(
        body.vertices32, body.faces, scalar=index, options=_POOLS, pairs=pairs
    ).labels

    def cut(k: int) -> Int32:  # noqa: ARG001  finds the number itself
        return pools

    return cut


TPA: Final = Cutter(
    "tpa",
    "Triangle Pool Algorithm",
    "the thesis, sections 3.5 and 5.4.2",
    takes_k=False,
    prepare=_prepare,
    thesis="TPA",
)
