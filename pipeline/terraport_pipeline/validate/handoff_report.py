"""What the proof of the hand-off is asked, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from terraport_pipeline.errors import OptionError

__all__ = ["HandOffOptions", "HandOffReport", "KindReport", "WorstRay"]


@dataclass(frozen=True, slots=True)
class HandOffOptions:
    """Number of rays and of subsets of loaded segments, and the seed."""

    rays: int = 1_000_000
    """Rays in all, shared evenly among the subsets."""
    subsets: int = 100
    """Random sets of loaded segments."""
    seed: int = 0
    """Seed of rays and subsets; the same gives the same proof."""

    def __post_init__(self) -> None:
        if self.subsets < 1 or self.rays < self.subsets:
            raise OptionError(
                f"received {self.rays} rays and {self.subsets} subsets; "
                "expected at least 1 subset and at least one ray for each"
            )


@dataclass(frozen=True, slots=True)
class KindReport:
    """Rays, hits and holes of one vantage point."""

    kind: str
    """``"down"``, ``"above"``, ``"eye"`` or ``"grazing"``."""
    rays: int
    hits: int
    """Rays that met the full detail."""
    strict_misses: int
    holes: int


@dataclass(frozen=True, slots=True)
class WorstRay:
    """The ray that fared worst: a hole if there is one, otherwise the largest known distance."""

    origin: tuple[float, float, float]
    direction: tuple[float, float, float]
    target: tuple[float, float, float]
    """Where it meets the full detail, metres."""
    distance_m: float
    """To the mixed model; ``inf`` for a hole with nothing in reach."""
    hole: bool
    verdict: Literal["hole", "excused", "distance"]
    """``"excused"``: no hole, but a strict miss on a ray that meets the full base;
    ``"distance"``: neither, only the largest distance within four tolerances."""
    kind: str
    loaded: tuple[int, ...]
    """Segments loaded at the time."""


@dataclass(frozen=True, slots=True)
class HandOffReport:
    """Counts and distances of the proof that detail replaces base without holes."""

    rays: int
    subsets: int
    seed: int
    tolerance_m: float
    hits: int
    """Rays that met the full detail: only they can find a hole."""
    strict_misses: int
    """Of the hits, rays on which the mixed model is missing up to detail, base and tolerance."""
    base_misses: int
    """Of the strict misses, rays that miss the full base too: outlines, whatever is loaded."""
    under_base: int
    """Of the strict misses, rays whose eye stands below the mixed model and not below the detail:
    the base lies higher than the viewer's head where no detail is loaded."""
    smoothed: int
    """Rays at things that the base does not have, though there is ground below them."""
    holes_hidden: int
    """Places where a base face was hidden and nothing took its place."""
    holes_uncovered: int
    """Places of the detail over and under which there is no base at all."""
    unverified: int
    """Of both, rays that were not judged against a built mixed model."""
    distance_m: dict[str, float]
    """Percentiles (``p50``, ``p99``, ``p99.9``, ``max``) of the distance from the full detail to
    the mixed model, over all hits but those of grazing rays."""
    down_distance_m: dict[str, float]
    """The same over downward rays, along the ray: a plain difference of heights."""
    overlap: float
    """Share of hits on loaded detail that a base face still shown lies before (the rim)."""
    kinds: tuple[KindReport, ...]
    worst: WorstRay | None
    windows: int = 1
    """Parts that the scene was looked at in; 1 where it was held whole."""

    @property
    def holes(self) -> int:
        """Number of rays that meet full detail and fall through the mixed model."""
        return self.holes_hidden + self.holes_uncovered

    @property
    def holes_per_million(self) -> float:
        """Holes per million rays that met the full detail; 0 when none did."""
        return 1e6 * self.holes / self.hits if self.hits else 0.0
