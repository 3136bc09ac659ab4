"""Options of the cleaning of points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import Option, check_options

__all__ = ["MIN_POINTS", "Options"]

MIN_POINTS: Final = 50
"""Different points below which a surface cannot be told from chance."""


@dataclass(frozen=True, slots=True)
class Options:
    """Outlier rule and number of neighbours: how strictly to clean."""

    outlier_ratio: Annotated[float, Option(above=1)] = 3.0
    """A point goes when it stands this many times farther from its neighbours than they do from
    theirs. Lower removes more noise, and thin things (wires, fences) with it."""
    outlier_deviations: float = 3.0
    """And this many robust standard deviations above the cloud's median. Lower removes more."""
    normal_neighbours: int = 16
    """Points per normal. More smooths noise, and rounds edges."""

    def __post_init__(self) -> None:
        check_options(self)
        if not self.outlier_deviations >= 0:
            raise OptionError(f"outlier deviations {self.outlier_deviations}; expected at least 0")
        if not 6 <= self.normal_neighbours <= 64:
            raise OptionError(f"normal neighbours {self.normal_neighbours}; expected 6 to 64")
