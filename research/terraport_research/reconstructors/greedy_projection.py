"""Greedy projection triangulation."""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_research.kernels.greedy_projection import project_greedily
from terraport_research.reconstructors.contract import (
    Reconstructor,
    Samples,
    Surface,
    Work,
)

__all__ = ["GREEDY_PROJECTION"]

RADIUS_SPACINGS: Final = 4.0
"""Longest edge; on noisy samples a smaller one leaves more holes."""
MU: Final = 3.0
"""Neighbours within this many times the nearest one's distance; PCL's tutorial has 2.5."""


def _run(samples: Samples, _work: Work) -> Surface:
    radius_m = RADIUS_SPACINGS * samples.spacing_m
    return Surface(
        samples.points,
        project_greedily(samples.points, samples.normals, radius_m, MU),
        np.arange(len(samples.points), dtype=np.int32),
        f"edges up to {RADIUS_SPACINGS:g} spacings",
    )


GREEDY_PROJECTION: Final = Reconstructor(
    key="greedy-projection",
    title="Fast surface reconstruction",
    implementation="terraport (numba)",
    thesis_used="Point Cloud Library",
    paper="Marton, Rusu and Beetz 2009",
    one_sheet=False,
    run=_run,
)
