"""What places on a closed body see of each other through its inside, by rays (Embree).

S. Asafi, A. Goren, D. Cohen-Or, "Weak convex decomposition by lines-of-sight", Computer Graphics
Forum 32(5), 2013: within a convex part all places see each other, and parts see little of others.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float32, Float64, Int32
from terraport_pipeline.engines.rays import RayScene

__all__ = ["SAMPLES", "body_sight"]

SAMPLES: Final = 512
"""Places: 130,000 rays, a tenth of a second."""
_DEPTH_SHARE: Final = 0.01
"""Places lie this share of the box's diagonal below the surface, or a fifth of the body's thickness
where that is less: not to be hidden by the faces beside."""
_REACHED: Final = 1.0 - 1e-4
"""A ray that goes this far is there."""


def body_sight(
    vertices: Float32,
    faces: Int32,
    area: Float64,
    centres: Float64,
    normals: Float64,
    thickness: Float64,
    *,
    threads: int = 1,
) -> tuple[Int32, Bool]:
    """Say which of some hundred places, spread evenly, see each other inside a body.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Any unit.
    faces : ndarray of shape (F, 3), int32
        Wound so that normals point out of the body.
    area, centres, normals
        Of the faces: (F,), (F, 3), (F, 3) unit; in the vertices' frame.
    thickness : ndarray of shape (F,), float64
        Shape diameter; NaN where there is none.
    threads : int
        Threads that trace; they change nothing but the time.

    Returns
    -------
    samples : ndarray of shape (S,), int32
        Faces under the places; large ones several times.
    sees : ndarray of shape (S, S), bool
        Symmetric; every place sees itself.
    """
    reach = np.cumsum(area)
    if len(faces) == 0 or reach[-1] <= 0.0:
        return np.zeros(0, np.int32), np.zeros((0, 0), np.bool_)
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES * reach[-1]
    samples = np.minimum(np.searchsorted(reach, steps), len(faces) - 1).astype(np.int32)
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    depth = np.minimum(
        _DEPTH_SHARE * diagonal, 0.2 * np.nan_to_num(thickness[samples], nan=1e-3 * diagonal)
    )
    places = centres[samples] - depth[:, None] * normals[samples]
    a, b = np.triu_indices(SAMPLES, 1)
    way = places[b] - places[a]
    length = np.sqrt((way * way).sum(axis=1))
    way /= np.maximum(length, np.finfo(np.float64).tiny)[:, None]
    met_at, face = RayScene(vertices, faces, threads=threads).closest_hit(places[a], way)
    sees = np.zeros((SAMPLES, SAMPLES), np.bool_)
    sees[a, b] = (face < 0) | (met_at >= _REACHED * length)
    sees |= sees.T
    np.fill_diagonal(sees, val=True)
    return samples, sees
