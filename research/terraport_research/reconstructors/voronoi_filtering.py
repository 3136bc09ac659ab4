"""Voronoi filtering: the crust."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import QhullError

from terraport_pipeline.errors import EngineError
from terraport_research.kernels.voronoi_crust import crust
from terraport_research.reconstructors.contract import (
    Reconstructor,
    Samples,
    Surface,
    Work,
)

__all__ = ["VORONOI_FILTERING"]


def _run(samples: Samples, _work: Work) -> Surface:
    try:
        faces = crust(samples.points, samples.normals)
    except QhullError as error:
        raise EngineError(f"no Delaunay triangulation in space: {str(error)[:200]}") from error
    return Surface(
        samples.points,
        faces,
        np.arange(len(samples.points), dtype=np.int32),
        "filtered by normals at 40 degrees",
    )


VORONOI_FILTERING: Final = Reconstructor(
    key="voronoi-filtering",
    title="Voronoi filtering",
    implementation="terraport on SciPy (Qhull)",
    thesis_used="MeshLab",
    paper="Amenta and Bern 1999",
    one_sheet=False,
    run=_run,
)
