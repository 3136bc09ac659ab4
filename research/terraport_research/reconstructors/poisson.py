"""Screened Poisson as a build runs it: depth by density, trimmed by support, islands removed."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_pipeline.engines import poisson as solver
from terraport_pipeline.geometry.mesh.trim import compact, island_mask, support_mask
from terraport_research.reconstructors.contract import (
    Reconstructor,
    Samples,
    Surface,
    Work,
)

__all__ = ["POISSON"]

DEEPEST: Final = 13
TRIM_SPACINGS: Final = 4.0
ISLAND_FACES: Final = 200
"""The defaults of ``terraport build``."""


def _run(samples: Samples, work: Work) -> Surface:
    extent_m = float(np.ptp(samples.points, axis=0).max())
    depth = work.depth or solver.depth_for(DEEPEST, extent_m, samples.spacing_m)
    vertices, faces = solver.reconstruct(samples.points, samples.normals, depth, work.scratch)
    tree = cKDTree(samples.points, balanced_tree=False)
    keep = support_mask(
        vertices,
        faces,
        tree,
        samples.local_spacing_m,
        spacings=TRIM_SPACINGS,
        workers=work.threads,
    )
    solved = len(faces)
    vertices, faces = compact(vertices, faces, keep)
    keep, _ = island_mask(faces, len(vertices), min_faces=ISLAND_FACES)
    vertices, faces = compact(vertices, faces, keep)
    return Surface(vertices, faces, None, f"octree depth {depth}", solved)


POISSON: Final = Reconstructor(
    key="poisson",
    title="Poisson surface reconstruction",
    implementation="PoissonRecon 18.75 in pycolmap, trimmed by support",
    thesis_used="CloudCompare",
    paper="Kazhdan and Hoppe 2013",
    one_sheet=False,
    run=_run,
)
