"""The graph engine on bodies, told the number of segments and not."""

from __future__ import annotations

from typing import Final

from terraport_payload.types import Int32
from terraport_pipeline.geometry.graph.part_merge import LIKELY
from terraport_research.cutters.contract import Body, Cut, Cutter

__all__ = ["AUTOMATIC", "GRAPH"]


def _prepare(body: Body) -> Cut:
    parts = body.parts

    def cut(k: int) -> Int32:
        return parts.cut_by_count(k)[0]

    return cut


def _prepare_automatic(body: Body) -> Cut:
    labels, _ = body.parts.cut_by_likelihood(LIKELY)

    def cut(k: int) -> Int32:  # noqa: ARG001  finds the number itself
        return labels

    return cut


GRAPH: Final = Cutter(
    "graph",
    "Graph, told k",
    "terraport: pieces of the normalised cut, united by likelihood",
    takes_k=True,
    prepare=_prepare,
)
AUTOMATIC: Final = Cutter(
    "automatic",
    "Graph, automatic",
    "terraport: the same, while most people would unite",
    takes_k=False,
    prepare=_prepare_automatic,
)
