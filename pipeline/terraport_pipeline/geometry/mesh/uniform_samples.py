"""Points spread evenly over a triangle mesh.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np

from terraport_payload.types import AnyFloat, Float64, Int32

__all__ = ["sample_mesh", "sample_weights"]


def sample_mesh(
    vertices: AnyFloat, faces: Int32, count: int, rng: np.random.Generator
) -> tuple[Float64, Int32]:
    """Draw points by area, one from each n-th of it in the order of the faces.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Metres.
    faces : ndarray of shape (F, 3), int32
        F >= 1, not all without area.
    count : int
    rng : numpy.random.Generator
        The same state gives the same points.

    Returns
    -------
    points : ndarray of shape (count, 3), float64
    face : ndarray of shape (count,), int32
        The face that each point lies on.

    Raises
    ------
    ValueError
        The mesh has no area.
    """
    weights, face = sample_weights(vertices, faces, count, rng)
    corners = np.asarray(vertices, np.float64)[faces[face]]
    return np.einsum("pc,pck->pk", weights, corners), face


def sample_weights(
    vertices: AnyFloat, faces: Int32, count: int, rng: np.random.Generator
) -> tuple[Float64, Int32]:
    """Draw points as :func:`sample_mesh`, as shares of the corners of their faces.

    Returns
    -------
    weights : ndarray of shape (count, 3), float64
    face : ndarray of shape (count,), int32
    """
    corners = np.asarray(vertices, np.float64)[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    passed = np.cumsum(np.linalg.norm(normal, axis=1))
    if len(passed) == 0 or not passed[-1] > 0:
        raise ValueError(f"received {len(faces)} faces without area, expected a surface")
    spot = (np.arange(count) + rng.uniform(size=count)) / count * passed[-1]
    face = np.minimum(np.searchsorted(passed, spot, side="right"), len(faces) - 1)
    # A square root makes the draw even over a triangle (Turk, "Generating random points in
    # triangles", Graphics Gems, 1990).
    across, along = np.sqrt(rng.uniform(size=count)), rng.uniform(size=count)
    weights = np.stack([1 - across, across * (1 - along), across * along], axis=1)
    return weights, face.astype(np.int32)
