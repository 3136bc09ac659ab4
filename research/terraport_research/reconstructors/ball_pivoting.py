"""Ball pivoting with three balls."""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_research.kernels.ball_pivoting import pivot_balls
from terraport_research.reconstructors.contract import (
    Reconstructor,
    Samples,
    Surface,
    Work,
)

__all__ = ["BALL_PIVOTING"]

RADII_SPACINGS: Final = (1.0, 2.0, 4.0)
"""The smallest ball that does not fall between even samples, and two for what it leaves open."""


def _run(samples: Samples, _work: Work) -> Surface:
    radii_m = [samples.spacing_m * factor for factor in RADII_SPACINGS]
    faces = pivot_balls(samples.points, samples.normals, radii_m)
    named = ", ".join(f"{factor:g}" for factor in RADII_SPACINGS)
    return Surface(
        samples.points,
        faces,
        np.arange(len(samples.points), dtype=np.int32),
        f"balls of {named} spacings",
    )


BALL_PIVOTING: Final = Reconstructor(
    key="ball-pivoting",
    title="Ball Pivoting",
    implementation="terraport (numba)",
    thesis_used="MeshLab",
    paper="Bernardini et al. 1999",
    one_sheet=False,
    run=_run,
)
