"""Graph segmentation after Felzenszwalb and Huttenlocher, on faces instead of pixels.

Neighbouring faces are joined in the order of their colour difference w. Two parts join when w is no
larger than the largest w inside either, plus ``scale / faces`` of that part: a part may grow over
differences like those it already holds, and small parts are given slack. What stays below a least
size then joins over its smallest difference.

The paper's graph has one node per pixel and the intensity difference as w; here a node is a face
and w the CIELAB distance (or the difference of the scalar). Sizes count faces, as the paper counts
pixels.

PURE: no I/O, no clock. O(P log P) for the sort of the pairs, everything else nearly linear.

References
----------
P. F. Felzenszwalb, D. P. Huttenlocher, "Efficient graph-based image segmentation", IJCV 59(2),
2004: Algorithm 1, threshold function (5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from terraport_payload.types import Float32, Int32, Int64
from terraport_pipeline.geometry.regions.colour import (
    face_colour_sums,
    srgb_to_lab,
    white_distance_of_sums,
)
from terraport_pipeline.geometry.regions.engine_options import (
    FELZENSZWALB_SCALE,
    FELZENSZWALB_SHARE,
)
from terraport_pipeline.geometry.regions.pool_refine import join_nearest, number_by_first
from terraport_pipeline.geometry.regions.segmenter import Segmentation, SegmenterMesh

__all__ = ["FelzenszwalbSegmenter", "felzenszwalb", "neighbour_differences"]


@dataclass(frozen=True, slots=True)
class FelzenszwalbSegmenter:
    """Felzenszwalb and Huttenlocher's graph segmentation, once for regions, once for fine pools."""

    region_scale: float = FELZENSZWALB_SCALE
    """k of the regions, CIELAB units x faces; larger gives larger parts. >= 0."""
    region_share: float = FELZENSZWALB_SHARE
    """Regions below this share of all faces join a neighbour. 0..1."""
    fine_scale: float = 10.0
    """k of the fine pools. >= 0."""
    fine_faces: int = 1
    """Fine pools below this many faces join a neighbour."""

    def __post_init__(self) -> None:
        """Refuse values outside their range before any work."""
        for name, high in (("region_scale", np.inf), ("region_share", 1.0), ("fine_scale", np.inf)):
            value = getattr(self, name)
            if not (0.0 <= value <= high and np.isfinite(value)):
                msg = f"{name} is {value}, expected a finite number in 0..{high:g}"
                raise ValueError(msg)

    @property
    def name(self) -> str:
        """Name of the engine in options and manifests: ``"felzenszwalb"``."""
        return "felzenszwalb"

    def segment(self, mesh: SegmenterMesh) -> Segmentation:
        """Cut the mesh into parts; see :class:`~.segmenter.Segmenter`.

        Regions that touch nothing and are too small join the region of the nearest face.
        """
        # (1) Differences over edges, sorted once for both runs.
        n_faces = len(mesh.faces)
        pairs, _ = mesh.edge_pairs()
        difference, similarity = neighbour_differences(mesh, pairs)
        order = np.argsort(difference, kind="stable")
        least = int(np.ceil(self.region_share * n_faces))
        regions, count = felzenszwalb(
            n_faces, pairs, difference, self.region_scale, least, order=order
        )
        # (2) Regions too small that touch nothing larger join the nearest.
        size = np.bincount(regions, minlength=1)
        lost = (size < least)[regions] if n_faces else np.zeros(0, np.bool_)
        if lost.any() and not lost.all():
            joined = join_nearest(mesh.vertices, mesh.faces, regions, size < least)
            regions, count = number_by_first(joined)
        # (3) Fine pools: the same with a finer scale.
        fine, _ = felzenszwalb(
            n_faces, pairs, difference, self.fine_scale, self.fine_faces, order=order
        )
        return Segmentation(
            regions=regions,
            region_count=count,
            fine=fine,
            similarity=similarity,
            facts={"region_islands": int(np.count_nonzero(size < least)) if n_faces else 0},
        )


def neighbour_differences(mesh: SegmenterMesh, pairs: Int32) -> tuple[Float32, Float32]:
    """Difference of every pair of neighbours, and an index of every face to compare pools by.

    Parameters
    ----------
    mesh : SegmenterMesh
        Its scalar, else its colours, else nothing (all alike) is compared.
    pairs : ndarray of shape (P, 2), int32
        Neighbouring faces.

    Returns
    -------
    difference : ndarray of shape (P,), float32
        CIELAB (1976) distance of the faces' mean colours, or difference of their scalars.
    index : ndarray of shape (F,), float32
        CIEDE2000 distance to white over 100, or the scalar.
    """
    if mesh.scalar is not None:
        index = mesh.scalar.astype(np.float32)
        return np.abs(index[pairs[:, 0]] - index[pairs[:, 1]]), index
    if mesh.colours is None:
        return np.zeros(len(pairs), np.float32), np.zeros(len(mesh.faces), np.float32)
    sums = face_colour_sums(mesh.colours, mesh.faces)
    lab = srgb_to_lab(sums.astype(np.float64) / 3.0).astype(np.float32)
    step = lab[pairs[:, 0]] - lab[pairs[:, 1]]
    index = white_distance_of_sums(sums, 3) / np.float32(100.0)
    return np.sqrt((step * step).sum(axis=1, dtype=np.float32)), index


def felzenszwalb(
    n_faces: int,
    pairs: Int32,
    difference: Float32,
    scale: float,
    least_faces: int,
    *,
    order: Int64 | None = None,
) -> tuple[Int32, int]:
    """Join neighbours in the order of their difference.

    Parameters
    ----------
    n_faces : int
        Number of faces.
    pairs : ndarray of shape (P, 2), int32
        Neighbouring faces.
    difference : ndarray of shape (P,), float32
        w of every pair, >= 0.
    scale : float
        k: slack of a part, times its number of faces.
    least_faces : int
        Parts below this join a neighbour afterwards, smallest difference first; parts that touch
        nothing stay.
    order : ndarray of shape (P,), int64, optional
        ``argsort(difference, kind="stable")`` where the caller has it.

    Returns
    -------
    labels : ndarray of shape (n_faces,), int32
        Numbered 0.. by each part's first face.
    count : int
        Number of parts.

    Notes
    -----
    Tie rule: pairs of equal difference in the order given (:func:`~.adjacency.face_pairs` sorts
    them by edge).

    Examples
    --------
    Six faces in a row; the step in the middle stays a border.

    >>> pairs = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 5]], dtype=np.int32)
    >>> steps = np.array([1, 1, 9, 1, 1], dtype=np.float32)
    >>> felzenszwalb(6, pairs, steps, 9.0, 1)[0].tolist()
    [0, 0, 0, 1, 1, 1]
    """
    if order is None:
        order = np.argsort(difference, kind="stable")
    labels = _join(n_faces, pairs, difference, order, float(scale), least_faces)
    return number_by_first(labels)


@numba.njit(cache=True)
def _root(parent: Int32, item: int) -> int:
    while parent[item] != item:
        parent[item] = parent[parent[item]]
        item = parent[item]
    return item


@numba.njit(cache=True)
def _join(
    n_faces: int,
    pairs: Int32,
    difference: Float32,
    order: Int64,
    scale: float,
    least_faces: int,
) -> Int32:
    parent = np.arange(n_faces).astype(np.int32)
    size = np.ones(n_faces, np.int64)
    # Largest difference inside each part plus its slack: the paper's Int(C) + tau(C). The pairs
    # come sorted, so the pair that joins two parts is the largest of the union.
    limit = np.full(n_faces, scale)
    for i in order:
        a, b = _root(parent, pairs[i, 0]), _root(parent, pairs[i, 1])
        if a != b and difference[i] <= limit[a] and difference[i] <= limit[b]:
            if size[a] < size[b]:
                a, b = b, a
            parent[b] = a
            size[a] += size[b]
            limit[a] = difference[i] + scale / size[a]
    for i in order:
        a, b = _root(parent, pairs[i, 0]), _root(parent, pairs[i, 1])
        if a != b and (size[a] < least_faces or size[b] < least_faces):
            if size[a] < size[b]:
                a, b = b, a
            parent[b] = a
            size[a] += size[b]
    for i in range(n_faces):
        parent[i] = _root(parent, i)
    return parent
