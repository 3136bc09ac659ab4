"""Points that stand for a labelled surface: so many faces to a point, none of a label forgotten.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float64, Int32

__all__ = ["SurfaceSamples", "surface_samples"]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSamples:
    """N points spread over a surface, each with its face's label and a share of the area."""

    points: Float64
    """(N, 3) metres."""
    labels: Int32
    """(N,) label of the surface there."""
    areas: Float64
    """(N,) square metres that the point stands for; per label they sum to its area."""

    @classmethod
    def joined(cls, pieces: Iterable[Self]) -> Self:
        """Put samples of several pieces together, in their order."""
        listed = list(pieces)
        if not listed:
            return cls(np.zeros((0, 3)), np.zeros(0, np.int32), np.zeros(0))
        return cls(
            np.concatenate([piece.points for piece in listed]),
            np.concatenate([piece.labels for piece in listed]),
            np.concatenate([piece.areas for piece in listed]),
        )


def surface_samples(
    vertices: AnyFloat,
    faces: AnyInt,
    labels: AnyInt,
    *,
    faces_per_sample: int,
    at_least: int = 64,
) -> SurfaceSamples:
    """Take centres of faces as samples, evenly by area within each label.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Metres.
    faces : ndarray of shape (F, 3), integer
        Vertex indices, neighbours near each other in the list (the more, the more even).
    labels : ndarray of shape (F,), integer
        Label of every face.
    faces_per_sample : int
        A label with n faces gets ceil(n / this) samples; 1 takes every face.
    at_least : int, optional
        But so many, or every face where it has fewer: a small label must not be a single point.

    Returns
    -------
    SurfaceSamples
        In ascending order of labels. Sample k of n stands for the k-th n-th of the label's area in
        the order of its faces, and lies in the face in the middle of that: systematic sampling
        with probability proportional to size (W. G. Cochran, "Sampling Techniques", 1977, section
        9A). Labels without any area: every face counts alike, with area 0.

    Examples
    --------
    >>> vertices = np.array([[0, 0, 0], [3, 0, 0], [0, 0, 3.0]])
    >>> surface_samples(vertices, np.array([[0, 1, 2]]), np.array([7]), faces_per_sample=9).areas
    array([4.5])
    """
    if labels.shape != (len(faces),):
        msg = f"labels have shape {labels.shape}, expected ({len(faces)},)"
        raise ValueError(msg)
    if faces_per_sample < 1:
        msg = f"{faces_per_sample} faces per sample, expected at least 1"
        raise ValueError(msg)
    if len(faces) == 0:
        return SurfaceSamples.joined([])
    # (1) Runs of faces with one label, their areas; a label without any area counts faces alike.
    order = np.argsort(labels, kind="stable")
    sorted_labels = labels[order]
    starts = np.flatnonzero(np.append(True, sorted_labels[1:] != sorted_labels[:-1]))
    sizes = np.diff(np.append(starts, len(order)))
    a, b, c = (vertices[faces[order, corner]].astype(np.float64) for corner in range(3))
    normal = np.cross(b - a, c - a)
    area = 0.5 * np.sqrt((normal * normal).sum(axis=1))
    whole = np.add.reduceat(area, starts)
    weight = np.where(np.repeat(whole, sizes) > 0.0, area, 1.0)
    total = np.add.reduceat(weight, starts)
    # (2) How many samples each label gets.
    counts = np.minimum(sizes, np.maximum(-(-sizes // faces_per_sample), at_least))
    # (3) Faces at evenly spaced steps of the running area, within each label's own run.
    passed = np.cumsum(weight)
    ends = starts + sizes - 1
    before = np.concatenate([[0.0], passed[ends[:-1]]])
    label_of = np.repeat(np.arange(len(starts)), counts)
    rank = np.arange(len(label_of)) - np.repeat(np.cumsum(counts) - counts, counts)
    target = before[label_of] + (rank + 0.5) / counts[label_of] * total[label_of]
    chosen = np.clip(np.searchsorted(passed, target), starts[label_of], ends[label_of])
    return SurfaceSamples(
        (a[chosen] + b[chosen] + c[chosen]) / 3.0,
        sorted_labels[starts][label_of].astype(np.int32),
        (whole / counts)[label_of],
    )
