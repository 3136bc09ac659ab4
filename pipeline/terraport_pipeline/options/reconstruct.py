"""Options of the reconstruction: how finely."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal

from terraport_pipeline.option import COUNT, Option, check_options

__all__ = ["BASE_DEPTH", "NAME", "POINT_WEIGHT", "Options"]

NAME: Final = "reconstruct"

BASE_DEPTH: Final = 9
"""Octree depth of a base by "poisson" where none was asked for."""

POINT_WEIGHT: Final = 4.0
"""Weight of the points against smoothness in screened Poisson, the solver's own default."""

_MAX_DEPTH: Final = 16
"""Largest octree depth that a 64-bit build of the solver takes."""


@dataclass(frozen=True, slots=True)
class Options:
    """Octree depths, faces of the base and where to cut: how finely to reconstruct."""

    base_from: Annotated[Literal["detail", "poisson"], Option()] = "detail"
    """How the base is made, the coarse mesh that is always there. detail thins the detail: ten
    times nearer to it, and the same outline. poisson solves it apart, as the thesis does."""
    base_depth: Annotated[
        int | None,
        Option(least=3, most=_MAX_DEPTH, unset=f"{BASE_DEPTH}, and below the detail"),
    ] = None
    """Octree depth of a base by poisson; lower is lighter and farther from the detail."""
    detail_depth: Annotated[
        int | None,
        Option(least=3, most=_MAX_DEPTH, unset="cells by the density and the noise of the points"),
    ] = None
    """Octree depth of the detail, as the thesis counts: one less gives a quarter of the faces. More
    than density and noise of the points support is lowered to it."""
    base_faces: Annotated[int, Option(least=100, notation=COUNT)] = 200_000
    """Faces that the base is thinned to. Every client holds all of it all the time."""
    trim_spacings: Annotated[float, Option(least=1)] = 4.0
    """Surface farther than this many spacings of the points from a point goes; between what the
    histogram of support says and this, gaps between points stay and borders go. Higher closes more
    holes, and invents more."""
    island_faces: Annotated[int, Option(least=1)] = 200
    """Loose pieces of detail with fewer faces go."""
    point_weight: Annotated[float, Option(least=0, most=100)] = POINT_WEIGHT
    """How closely Poisson follows the points. Higher follows them and their noise, lower
    smooths."""

    def __post_init__(self) -> None:
        check_options(self)
