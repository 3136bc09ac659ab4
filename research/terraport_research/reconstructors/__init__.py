"""Reconstruction algorithms behind one interface, for ``terraport evaluate reconstruction``.

The build uses Poisson alone (:mod:`terraport_pipeline.engines.poisson`); these are here so that
the thesis's comparison can be run again, on anybody's clouds.
"""

from __future__ import annotations

from typing import Final

from terraport_research.reconstructors.ball_pivoting import BALL_PIVOTING
from terraport_research.reconstructors.contract import (
    Reconstructor,
    Samples,
    Surface,
    Work,
)
from terraport_research.reconstructors.delaunay import DELAUNAY
from terraport_research.reconstructors.greedy_projection import GREEDY_PROJECTION
from terraport_research.reconstructors.marching_cubes import MARCHING_CUBES
from terraport_research.reconstructors.poisson import POISSON
from terraport_research.reconstructors.voronoi_filtering import VORONOI_FILTERING

__all__ = ["RECONSTRUCTORS", "Reconstructor", "Samples", "Surface", "Work"]

RECONSTRUCTORS: Final[dict[str, Reconstructor]] = {
    one.key: one
    for one in (
        DELAUNAY,
        MARCHING_CUBES,
        VORONOI_FILTERING,
        BALL_PIVOTING,
        POISSON,
        GREEDY_PROJECTION,
    )
}
"""Every algorithm by its key, in the order of the thesis's Table 3.1."""
