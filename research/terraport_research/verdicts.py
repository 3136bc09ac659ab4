"""The thesis's Tables 3.1 and 3.2 with measured columns: the rules, and what the thesis said.

Source: "Efficient rendering of real-world environments in a virtual reality application, using
segmented multi-resolution meshes", section 3.3. There the eye decided, and an algorithm that lost
colour was not tried further.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from terraport_research.scores import Scores

__all__ = [
    "RULES",
    "THESIS_COLOUR",
    "THESIS_SHAPE",
    "ColourVerdict",
    "ShapeVerdict",
    "judge_colour",
    "judge_shape",
]

MOST_LOST: Final = 0.01
MOST_SPACINGS: Final = 1.0

RULES: Final = {
    "colour": (
        "kept: for 95 % of the samples the mesh's colour at the nearest place differs by no more "
        "than neighbouring samples differ between themselves, and at most 1 % of the samples have "
        "no surface within two spacings"
    ),
    "holes": (
        "present: any group of open edges away from the truth's own end (the outline of a sheet "
        "is none)"
    ),
    "similar": (
        "95 % of the reconstruction lies within one spacing of the truth, and 95 % of the truth "
        "within one spacing of the reconstruction, on every model"
    ),
}

THESIS_COLOUR: Final[dict[str, bool]] = {
    "delaunay": True,
    "marching-cubes": False,
    "voronoi-filtering": False,
    "ball-pivoting": True,
    "poisson": True,
    "greedy-projection": False,
}
"""Table 3.1, "RGB Preservation"; True also meant "Proceed"."""

THESIS_SHAPE: Final[dict[str, tuple[bool, bool]]] = {
    "delaunay": (False, False),
    "ball-pivoting": (True, True),
    "poisson": (False, True),
}
"""Table 3.2: holes present, similar to original. The others were eliminated before."""


@dataclass(frozen=True, slots=True)
class ColourVerdict:
    """Colour fidelity of an algorithm, measured and in the thesis: a row of Table 3.1."""

    difference_p95: float
    allowed_p95: float
    lost: float
    kept: bool
    thesis_kept: bool


@dataclass(frozen=True, slots=True)
class ShapeVerdict:
    """Holes and distances of an algorithm over all models: a row of Table 3.2."""

    holes: int
    worst_to_truth_p95: float
    worst_from_truth_p95: float
    has_holes: bool
    similar: bool
    thesis: tuple[bool, bool] | None

    @property
    def proceed(self) -> bool:
        """Whether the algorithm passes the table: no holes, and similar to the truth."""
        return self.similar and not self.has_holes


def judge_colour(key: str, scores: Scores, neighbour_colour_p95: float) -> ColourVerdict:
    """Apply the rule of Table 3.1 to one algorithm on one cloud."""
    kept = scores.colour_p95 <= neighbour_colour_p95 and scores.samples_lost <= MOST_LOST
    return ColourVerdict(
        scores.colour_p95, neighbour_colour_p95, scores.samples_lost, kept, THESIS_COLOUR[key]
    )


def judge_shape(key: str, models: Iterable[Scores]) -> ShapeVerdict:
    """Apply the rules of Table 3.2 to one algorithm on several models (at least one)."""
    scores = list(models)
    to_truth = max(one.to_truth.p95 for one in scores)
    from_truth = max(one.from_truth.p95 for one in scores)
    holes = sum(one.holes for one in scores)
    return ShapeVerdict(
        holes,
        to_truth,
        from_truth,
        has_holes=holes > 0,
        similar=max(to_truth, from_truth) <= MOST_SPACINGS,
        thesis=THESIS_SHAPE.get(key),
    )
