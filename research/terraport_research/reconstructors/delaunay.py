"""Delaunay triangulation in plan: a height field over the ground."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import Delaunay, QhullError

from terraport_pipeline.errors import EngineError
from terraport_research.reconstructors.contract import (
    Reconstructor,
    Samples,
    Surface,
    Work,
)

__all__ = ["DELAUNAY"]


def _run(samples: Samples, _work: Work) -> Surface:
    plan = samples.points[:, [0, 2]].astype(np.float64)
    try:
        triangles = Delaunay(plan - plan.mean(axis=0)).simplices
    except QhullError as error:
        raise EngineError(f"no Delaunay triangulation in plan: {str(error)[:200]}") from error
    # Qhull's triangles are counter-clockwise in (x, z); seen from above, z runs the other way.
    faces = triangles[:, [0, 2, 1]].astype(np.int32)
    return Surface(
        samples.points, faces, np.arange(len(samples.points), dtype=np.int32), "2.5-D, in plan"
    )


DELAUNAY: Final = Reconstructor(
    key="delaunay",
    title="Delaunay triangulation",
    implementation="SciPy (Qhull), 2.5-D",
    thesis_used="CloudCompare",
    paper="Delaunay 1934",
    one_sheet=True,
    run=_run,
)
