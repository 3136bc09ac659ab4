"""The true surface as a coloured mesh whose faces know their material: for scoring segmentation.

What a perfect survey and a perfect reconstruction would give. Faces that nobody can see (below the
ground, inside another body) are left out, as every reconstruction leaves them out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Int32, UInt8
from terraport_pipeline.synth.appearance import Sunlight, photographed
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.surface import Surface

__all__ = ["TruthMesh", "truth_mesh"]

_BODY_ROUNDS: Final = 1
"""80 faces for the smallest bush: finer ones would be a fifth of all faces, and no reconstruction
spends its faces so."""


@dataclass(frozen=True, slots=True, eq=False)
class TruthMesh:
    """The true surface as a triangle mesh, with the material of every face."""

    vertices: Float32
    """(V, 3) metres, scene frame: x east, y up, z south."""
    faces: Int32
    """(F, 3) vertex indices, counter-clockwise seen from outside."""
    colours: UInt8
    """(V, 3) sRGB, with the options' light and noise."""
    material: UInt8
    """(F,) :class:`~.materials.Material` at the face's middle."""


def truth_mesh(options: QuarryOptions, max_edge_m: float) -> TruthMesh:
    """Triangulate the true surface and photograph its vertices.

    Parameters
    ----------
    options : QuarryOptions
        What to make; ``points``, ``noise_m``, ``holes``, ``outlier_fraction`` and ``uneven`` belong
        to the sensor and change nothing here. Equal shape options give equal geometry whatever the
        colour options.
    max_edge_m : float
        Bound on every edge, metres. A 360 m site has about 250,000 faces at 1.6.

    Returns
    -------
    TruthMesh
        Equal options give equal bytes.

    Examples
    --------
    >>> mesh = truth_mesh(QuarryOptions(seed=1, size_m=40.0), 2.0)
    >>> mesh.faces.shape[0] == mesh.material.shape[0]
    True
    """
    surface = Surface(options)
    body, parameters, _, faces = surface.triangles(
        max_edge_m / options.scale, body_rounds=_BODY_ROUNDS
    )
    samples = surface.evaluate_at(body, parameters)
    colours = photographed(
        samples, surface, Sunlight(surface), options, np.random.default_rng([options.seed, 3])
    )
    middles = surface.evaluate_at(body[faces[:, 0]], parameters[faces].mean(axis=1))
    # A face goes with its middle: half a face stands in or out of the ground at most.
    seen = ~middles.hidden
    used, dense = np.unique(faces[seen], return_inverse=True)
    local = samples.positions[used] * options.scale
    vertices = np.stack([local[:, 0], local[:, 2], -local[:, 1]], axis=1).astype(np.float32)
    return TruthMesh(
        np.ascontiguousarray(vertices),
        dense.reshape(-1, 3).astype(np.int32),
        colours[used],
        middles.material[seen],
    )
