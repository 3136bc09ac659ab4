"""Marching cubes over a signed distance to the samples' tangent planes."""

from __future__ import annotations

from typing import Final

from terraport_research.kernels.signed_distance import march_samples
from terraport_research.reconstructors.contract import (
    Reconstructor,
    Samples,
    Surface,
    Work,
)

__all__ = ["MARCHING_CUBES"]

CELL_SPACINGS: Final = 1.0
REACH_SPACINGS: Final = 3.0
"""The surface ends this far from the last sample."""


def _run(samples: Samples, work: Work) -> Surface:
    vertices, faces = march_samples(
        samples.points,
        samples.normals,
        cell_m=CELL_SPACINGS * samples.spacing_m,
        reach_m=REACH_SPACINGS * samples.spacing_m,
        workers=work.threads,
    )
    return Surface(vertices, faces, None, f"cells of {CELL_SPACINGS:g} spacing")


MARCHING_CUBES: Final = Reconstructor(
    key="marching-cubes",
    title="Marching cubes",
    implementation="terraport (NumPy): narrow-band signed distance",
    thesis_used="MeshLab",
    paper="Lorensen and Cline 1987; Hoppe et al. 1992",
    one_sheet=False,
    run=_run,
)
