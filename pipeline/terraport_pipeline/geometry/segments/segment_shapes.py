"""How wide and compact segments are; the build's facts give their quantiles.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float64
from terraport_pipeline.geometry.mesh.face_measures import face_areas
from terraport_pipeline.geometry.segments.segments import Segments

__all__ = ["QUANTILES", "box_diagonals", "raggedness"]


QUANTILES: Final = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
"""Least, 5th, 25th, 50th, 75th, 95th percentile, greatest."""


def raggedness(
    vertices: AnyFloat,
    faces: AnyInt,
    segments: Segments,
    *,
    threads: int = 1,
) -> Float64:
    """Diagonal of every segment's box over the square root of its area, (S,) float64.

    1.4 for a flat square along the axes, 2 for one across them, 3.2 for a strip of 1 to 10; a
    landing near a ragged segment fetches much of it in vain.
    """
    area = np.bincount(
        segments.labels, weights=face_areas(vertices, faces, threads=threads),
        minlength=segments.count,
    )  # fmt: skip
    diagonal = box_diagonals(segments)
    return diagonal / np.maximum(np.sqrt(area), np.finfo(np.float64).tiny ** 0.5)


def box_diagonals(segments: Segments) -> Float64:
    """Length of the diagonal of every segment's box, (S,) float64, metres."""
    side = segments.bounds[:, 3:].astype(np.float64) - segments.bounds[:, :3]
    diagonal: Float64 = np.sqrt((side * side).sum(axis=1))
    return diagonal
