"""Segmentation algorithms behind one interface, for ``terraport evaluate segmentation``.

A build and ``terraport segment`` have the pipeline's engines; these are here so that the thesis's
comparison on Princeton's models can be run again.
"""

from __future__ import annotations

from typing import Final

from terraport_research.cutters.colour_growing import COLOUR_GROWING
from terraport_research.cutters.contract import Body, Cut, Cutter
from terraport_research.cutters.core_extraction import CORE_EXTRACTION
from terraport_research.cutters.double_threshold import DOUBLE_THRESHOLD
from terraport_research.cutters.fitting_primitives import FITTING_PRIMITIVES
from terraport_research.cutters.graph import AUTOMATIC, GRAPH
from terraport_research.cutters.k_means import K_MEANS
from terraport_research.cutters.normalised_cuts import NORMALISED_CUTS
from terraport_research.cutters.random_walks import RANDOM_WALKS
from terraport_research.cutters.randomised_cuts import RANDOMISED_CUTS
from terraport_research.cutters.shape_diameter import SHAPE_DIAMETER
from terraport_research.cutters.tpa import TPA

__all__ = ["COLOUR_CUTTERS", "CUTTERS", "Body", "Cut", "Cutter"]

CUTTERS: Final[dict[str, Cutter]] = {
    one.key: one
    for one in (
        AUTOMATIC,
        GRAPH,
        TPA,
        RANDOMISED_CUTS,
        NORMALISED_CUTS,
        SHAPE_DIAMETER,
        CORE_EXTRACTION,
        RANDOM_WALKS,
        FITTING_PRIMITIVES,
        K_MEANS,
    )
}
"""Every algorithm by its key, in the order of the page."""

COLOUR_CUTTERS: Final[dict[str, Cutter]] = {
    one.key: one for one in (COLOUR_GROWING, DOUBLE_THRESHOLD)
}
"""Algorithms for coloured ground: they compare colours, which Princeton's models do not have."""
