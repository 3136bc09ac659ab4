"""Parameters of the graph engine, and the settings for ground and for shape.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

__all__ = [
    "BODY_GRAPH",
    "COLOUR_GRAPH",
    "OPEN_SHAPE_GRAPH",
    "SHAPE_GRAPH",
    "EdgeWeights",
    "GraphOptions",
]

_MOST_ROUNDS: Final = 64
"""Maximum smoothing rounds: more would blur colours across whole pieces."""


@dataclass(frozen=True, slots=True)
class EdgeWeights:
    """How much a border weighs per length.

    1 where nothing tells two pieces apart, towards 0 where they should stay apart.
    """

    colour_scale: float = 2.5
    """CIELAB difference at which a border weighs 1/e; 0 leaves colour out. Lower keeps fainter
    borders, and noise. 0..1000."""
    colour_noise: float = 1.0
    """The scale is at least this many times the median difference between neighbouring pieces, so
    that noise everywhere leaves no borders. 0 trusts ``colour_scale`` alone. 0..100."""
    lightness: float = 0.25
    """Weight of the lightness difference against the colour difference; below 1 makes shadows
    fainter than changes of hue, 0 ignores light and dark altogether. 0..10."""
    concavity: float = 1.0
    """Exponent of ``1 - angle / pi`` where the surface folds inwards; 0 leaves shape out. On noisy
    ground every stone folds, so colour decides; shape alone wants about 20. 0..100."""

    def __post_init__(self) -> None:
        """Refuse values outside their range before any work."""
        for name, high in (
            ("colour_scale", 1000.0),
            ("colour_noise", 100.0),
            ("lightness", 10.0),
            ("concavity", 100.0),
        ):
            value = getattr(self, name)
            if not 0.0 <= value <= high:
                msg = f"{name} is {value}, expected a number in 0..{high:g}"
                raise ValueError(msg)


@dataclass(frozen=True, slots=True)
class GraphOptions:
    """Parameters of the graph engine; the defaults are for coloured ground."""

    threshold: float = 0.5
    """Regions merge while that lowers the normalised cut by more than this; scale-free. Larger
    gives more, smaller regions. > 0."""
    small_share: float = 0.003
    """Regions below this share of the whole area join a neighbour; 0 keeps them. 0..1."""
    smooth_rounds: int = 8
    """Times that every face's colour is averaged with its neighbours' first: against the noise of
    single points. 0..64."""
    fine_faces: int = 1000
    """Most faces of a fine pool. >= 1."""
    seed_faces: int | None = None
    """Most faces of a seed; None chooses by the mesh, 1 leaves seeds out. >= 1."""
    weights: EdgeWeights = field(default_factory=EdgeWeights)
    """How borders are weighed."""

    def __post_init__(self) -> None:
        """Refuse values outside their range before any work."""
        if not 0.0 < self.threshold < math.inf:
            msg = f"threshold is {self.threshold}, expected a finite number above 0"
            raise ValueError(msg)
        if not 0.0 <= self.small_share < 1.0:
            msg = f"small_share is {self.small_share}, expected 0 to below 1"
            raise ValueError(msg)
        if not 0 <= self.smooth_rounds <= _MOST_ROUNDS:
            msg = f"smooth_rounds is {self.smooth_rounds}, expected 0..{_MOST_ROUNDS}"
            raise ValueError(msg)
        for name in ("fine_faces", "seed_faces"):
            value = getattr(self, name)
            if value is not None and value < 1:
                msg = f"{name} is {value}, expected 1 or more"
                raise ValueError(msg)


COLOUR_GRAPH: Final = GraphOptions()
"""Options for coloured ground, or for a scalar used as colour."""
SHAPE_GRAPH: Final = GraphOptions(
    threshold=5.0, small_share=0.01, weights=EdgeWeights(colour_scale=0.0, concavity=20.0)
)
"""Options for shape only (CAD parts, scans without colour): concavity decides. Tuned on Princeton's
models (docs/topics/segmentation.md)."""
OPEN_SHAPE_GRAPH: Final = replace(SHAPE_GRAPH, threshold=2.5, small_share=0.003)
"""Options for the shape of open ground. Halving a flat square lowers the cut by 4, halving a ball
by 7.1: a threshold for closed bodies would split every field."""
BODY_GRAPH: Final = replace(SHAPE_GRAPH, small_share=0.002)
"""Options for the pieces of a closed body; the threshold is not used."""
