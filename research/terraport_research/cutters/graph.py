"""The graph engine on shape alone: told the number of segments, and not."""

from __future__ import annotations

from typing import Final

from terraport_payload.types import Int32
from terraport_pipeline.geometry.graph.graph_segmenter import (
    SHAPE_GRAPH,
    cut_by_count,
    cut_by_threshold,
)
from terraport_research.cutters.contract import Body, Cut, Cutter

__all__ = ["AUTOMATIC", "GRAPH"]


def _prepare(body: Body) -> Cut:
    graph, tree = body.graph, body.merge_tree

    def cut(k: int) -> Int32:
        return cut_by_count(graph, SHAPE_GRAPH, tree, k)[0]

    return cut


def _prepare_automatic(body: Body) -> Cut:
    labels, _ = cut_by_threshold(body.graph, SHAPE_GRAPH, body.merge_tree)

    def cut(k: int) -> Int32:  # noqa: ARG001  finds the number itself
        return labels

    return cut


GRAPH: Final = Cutter(
    "graph",
    "Graph, told k",
    "terraport: greedy merging by the normalised cut, folds weighed",
    takes_k=True,
    prepare=_prepare,
)
AUTOMATIC: Final = Cutter(
    "automatic",
    "Graph, automatic",
    "terraport: the same, cut at a threshold that knows no scale",
    takes_k=False,
    prepare=_prepare_automatic,
)
