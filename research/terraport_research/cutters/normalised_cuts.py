"""Normalised cuts: faces united while that lowers the normalised cut most, down to k.

References
----------
A. Golovinskiy, T. Funkhouser, "Randomized cuts for 3D mesh analysis", ACM Transactions on Graphics
27(5), 2008, section 5 (the compared method).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from terraport_payload.types import Int32
from terraport_pipeline.geometry.graph.graph_options import SHAPE_GRAPH
from terraport_pipeline.geometry.graph.graph_segmenter import merge_graph
from terraport_pipeline.geometry.graph.merge_tree import MergeTree
from terraport_research.cutters.contract import Body, Cut, Cutter

__all__ = ["NORMALISED_CUTS", "PAPER_CONCAVITY", "paper_tree"]

PAPER_CONCAVITY: Final = 10.0
"""Exponent of a concave fold's weight, as printed."""
_WEIGHTS: Final = replace(SHAPE_GRAPH.weights, concavity=PAPER_CONCAVITY)


def paper_tree(body: Body) -> MergeTree:
    """All unions, the one that lowers the normalised cut most first."""
    return merge_graph(body.graph, replace(SHAPE_GRAPH, weights=_WEIGHTS)).tree


def _prepare(body: Body) -> Cut:
    tree = paper_tree(body)

    def cut(k: int) -> Int32:
        return tree.cut_by_count(k)[0]

    return cut


NORMALISED_CUTS: Final = Cutter(
    "normalised-cuts",
    "Normalised Cuts",
    "Golovinskiy and Funkhouser 2008",
    takes_k=True,
    prepare=_prepare,
    thesis="NC",
)
