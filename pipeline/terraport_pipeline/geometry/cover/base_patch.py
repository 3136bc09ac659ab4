"""Put base under the detail wherever thinning took it away.

The hand-off's rule leaves no hole on any vertical line that meets the base (``cover.py``, rule 1).
So every vertical line that meets detail has to meet base. A hem around the base sees to that almost
everywhere; the rest, slivers and thin tongues at the outer edge, is found
(:mod:`~terraport_pipeline.geometry.cover.uncovered`) and patched with the surface that the base was
thinned from. Rejected: a wider hem (it shows beyond loaded detail, and no width is enough for a
tongue that the thinning takes away whole); dropping the detail there (it is the survey's).

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.cover.uncovered import uncovered_faces
from terraport_pipeline.geometry.mesh.trim import compact

__all__ = ["append_surface", "base_patch"]

Surface = tuple[Float32, Int32]


def base_patch(
    base: Surface, detail: Surface, wide: Surface, *, margin_m: float, threads: int = 1
) -> Surface:
    """Make the surface that has to join a base so that all detail lies over it.

    Parameters
    ----------
    base, detail, wide : (vertices, faces)
        (V, 3) float32 metres, scene frame, Y up; (F, 3) int32, wound consistently. `wide` is the
        detail with a hem.
    margin_m : float
        How far the patch reaches beyond the detail faces that lie over no base.
    threads : int
        They change nothing but the time.

    Returns
    -------
    vertices : ndarray of shape (P, 3), float32
    faces : ndarray of shape (Q, 3), int32
        Faces of `wide`, and of `detail` where that has none either. Empty where nothing is missing.
        With base and patch together, ``uncovered_faces`` finds no face of the detail.
    """
    vertices, faces = detail
    bare = np.flatnonzero(uncovered_faces(vertices, faces, *base, threads=threads))
    if not len(bare):
        return vertices[:0], faces[:0]
    tree = cKDTree(vertices[np.unique(faces[bare])])
    near = np.isfinite(tree.query(wide[0], distance_upper_bound=margin_m, workers=threads)[0])
    patch = compact(*wide, near[wide[1]].any(axis=1))
    left = uncovered_faces(vertices, faces[bare], *append_surface(base, patch), threads=threads)
    taken = np.zeros(len(faces), dtype=np.bool_)
    taken[bare[left]] = True
    return append_surface(patch, compact(vertices, faces, taken))


def append_surface(first: Surface, second: Surface) -> Surface:
    """Put two surfaces into one; vertices that coincide stay apart."""
    offset = np.int32(len(first[0]))
    return (
        np.concatenate([first[0], second[0]]),
        np.concatenate([first[1], second[1] + offset]).astype(np.int32),
    )
