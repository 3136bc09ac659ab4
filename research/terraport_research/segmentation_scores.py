"""Princeton's measures of two segmentations of one mesh, as the benchmark's programs compute them.

A segmentation is judged by its *cuts* (cut discrepancy) and by its *regions* (Hamming distance,
Rand index, consistency error); 0 is agreement for all. What the paper leaves open is as in the
benchmark's programs (MeshsegBenchmark 1.0):

- CD: vertices at the ends of cut edges, of both segmentations in one pool; each measured to the
  nearest vertex on the other's cuts along mesh edges; the mean, over the mean distance of the
  surface to its centroid. Undefined where one side has no cut.
- HD: the mean of Rm, the area of the reference outside its best matches, and Rf, the other way
  round, as shares of the whole.
- 1 - RI: pairs of faces, each counting alike, that are together in one and apart in the other.
  (The programs divide by half of n - 1 rounded down: 1/n more for an even number of faces.)
- GCE, LCE: refinement errors as shares of *area*, one for each cell of faces common to two
  segments, weighed by the cell's *number of faces*. 0 where a side has one segment or as many as
  faces.

Segments are first split into edge-connected pieces (:meth:`MeshFacts.split`): two arms under one
number are two segments.

PURE: no I/O, no clock.

References
----------
X. Chen, A. Golovinskiy, T. Funkhouser, "A benchmark for 3D mesh segmentation", ACM Transactions on
Graphics 28(3), 2009, section 4. W. M. Rand, "Objective criteria for the evaluation of clustering
methods", JASA 66(336), 1971. D. Martin et al., ICCV 2001 (consistency errors).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numba
import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.mesh.face_measures import face_areas, face_centres
from terraport_research.kernels.nearest_source import nearest_source, rows_of_edges

__all__ = [
    "METRICS",
    "MeshFacts",
    "Pieces",
    "Scores",
    "compare",
    "consistency_errors",
    "rand_error",
]

METRICS: Final = ("cd", "hd", "rm", "rf", "ri", "gce", "lce")
"""Fields of :class:`Scores`, in the order of the thesis's Tables B.1 to B.7."""


class Scores(NamedTuple):
    """How far a segmentation is from the reference; 0 is agreement."""

    cd: float
    """Cut discrepancy; NaN where a side has no cut."""
    hd: float
    """Hamming distance."""
    rm: float
    """Missing rate: share of the area that lies outside the best match of its reference segment."""
    rf: float
    """False alarm rate: the same of the segmentation's own segments."""
    ri: float
    """1 - Rand index."""
    gce: float
    """Global consistency error."""
    lce: float
    """Local consistency error."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """A segmentation in edge-connected pieces, and how far every vertex is from its cuts."""

    labels: Int32
    """(F,) piece of every face, 0..count-1."""
    count: int
    cut: Int32
    """(C,) vertices at the ends of cut edges, ascending."""
    distance: Float64
    """(V,) along mesh edges to the nearest of them; infinite where there is none to reach."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshFacts:
    """All that scores ask of a mesh, measured once."""

    area: Float64
    """(F,) of the faces."""
    pairs: Int32
    """(P, 2) faces that share an edge."""
    edges: Int32
    """(P, 2) vertices of that edge."""
    starts: Int64
    """(V + 1,) where each vertex's row of neighbours begins."""
    neighbours: Int32
    """(2E,) neighbours of all vertices, row by row."""
    lengths: Float64
    """(2E,) of the edges to them."""
    radius: float
    """Mean distance of the surface to its centroid."""

    @classmethod
    def of(cls, vertices: AnyFloat, faces: Int32) -> MeshFacts:
        """Measure a mesh.

        Parameters
        ----------
        vertices : ndarray of shape (V, 3), float
        faces : ndarray of shape (F, 3), int32
        """
        places = vertices.astype(np.float64)
        pairs, edges = face_pairs(faces, len(places))
        area, centres = face_areas(places, faces), face_centres(places, faces)
        whole = max(float(area.sum()), np.finfo(np.float64).tiny)
        centroid = (area[:, None] * centres).sum(axis=0) / whole
        away = np.sqrt(((centres - centroid) ** 2).sum(axis=1))
        # Every mesh edge, those of one face included: distances run along them too.
        sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]))
        sides = np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0).astype(np.int64)
        step = places[sides[:, 0]] - places[sides[:, 1]]
        starts, neighbours, lengths = rows_of_edges(
            len(places), sides, np.sqrt((step * step).sum(axis=1))
        )
        return cls(
            area,
            pairs,
            edges,
            starts,
            neighbours,
            lengths,
            float(np.dot(area, away)) / whole,
        )

    def split(self, labels: AnyInt) -> Pieces:
        """Split segments into edge-connected pieces, and measure distances from their cuts.

        Parameters
        ----------
        labels : ndarray of shape (F,), integer
            Segment of every face; any values.

        Raises
        ------
        ValueError
            Not one for each face.
        """
        if labels.shape != self.area.shape:
            msg = f"labels have shape {labels.shape}, expected {self.area.shape}"
            raise ValueError(msg)
        dense = np.unique(labels, return_inverse=True)[1].reshape(-1).astype(np.int32)
        pieces, count = components(len(labels), self.pairs, labels=dense)
        border = pieces[self.pairs[:, 0]] != pieces[self.pairs[:, 1]]
        cut = np.unique(self.edges[border]).astype(np.int32)
        distance, _ = nearest_source(self.starts, self.neighbours, self.lengths, cut)
        return Pieces(pieces, count, cut, distance)


def compare(mesh: MeshFacts, segmentation: Pieces, reference: Pieces) -> Scores:
    """Score a segmentation against a reference, a person's.

    Parameters
    ----------
    mesh : MeshFacts
    segmentation, reference : Pieces
        Of this mesh.

    Returns
    -------
    Scores
        Rm and Rf change places with the arguments; the others are the same.
    """
    n = len(mesh.area)
    a, b = segmentation, reference
    faces, area = _common(a.labels, b.labels, mesh.area, a.count, b.count)
    whole = max(float(area.sum()), np.finfo(np.float64).tiny)
    rm = 1.0 - float(area.max(axis=0, initial=0.0).sum()) / whole
    rf = 1.0 - float(area.max(axis=1, initial=0.0).sum()) / whole
    gce, lce = _consistency(faces, area)
    return Scores(
        _cut_discrepancy(mesh, a, b), (rm + rf) / 2, rm, rf, _rand_error(faces, n), gce, lce
    )


def rand_error(labels_a: AnyInt, labels_b: AnyInt, weights: Float64 | None = None) -> float:
    """One minus the Rand index: the share of face pairs on which two partitions disagree.

    A pair disagrees when its two faces lie in one part of one partition and in two parts of the
    other.

    Parameters
    ----------
    labels_a, labels_b : ndarray of shape (F,), integer
        Part of every face; any values, negative ones included.
    weights : ndarray of shape (F,), float64, optional
        Weight of every face (its area), >= 0. A pair weighs the product of its faces' weights.
        None: every face weighs 1, which is the published measure.

    Returns
    -------
    float
        0 (same partition) to 1. 0 for fewer than two faces. Exact without weights: whole numbers
        until the one division.

    Raises
    ------
    ValueError
        Arrays of different lengths, or weights that are negative or not finite.

    Examples
    --------
    Four faces; the pair (1, 2) is together in one only, and so is (2, 3).

    >>> rand_error(np.array([0, 0, 1, 1]), np.array([0, 5, 5, 9]))  # 3 of 6 pairs
    0.5
    """
    table = _table(labels_a, labels_b, weights)
    if weights is None:
        counts = [sizes.astype(np.int64) for sizes in (table.common, table.size_a, table.size_b)]
        both, in_a, in_b = (int(np.dot(sizes, sizes)) for sizes in counts)
        n = len(labels_a)
        return (in_a + in_b - 2 * both) / (n * (n - 1)) if n > 1 else 0.0
    pairs = float(weights.sum()) ** 2 - float(np.dot(weights, weights))
    # Summed by cell, not as the difference of three large squares: equal partitions give exactly 0.
    apart_b = float(np.dot(table.common, table.size_a[table.row] - table.common))
    apart_a = float(np.dot(table.common, table.size_b[table.column] - table.common))
    return max(apart_a + apart_b, 0.0) / pairs if pairs > 0.0 else 0.0


def consistency_errors(labels_a: AnyInt, labels_b: AnyInt, area: Float64) -> tuple[float, float]:
    """Global and local consistency error of two segmentations, as :class:`Scores` has them.

    Parameters
    ----------
    labels_a, labels_b : ndarray of shape (F,), integer
    area : ndarray of shape (F,), float64

    Returns
    -------
    gce, lce : float
        0 where one refines the other (one segment for everything included: never report them
        alone).
    """
    dense = [np.unique(labels, return_inverse=True)[1] for labels in (labels_a, labels_b)]
    a, b = (labels.reshape(-1).astype(np.int32) for labels in dense)
    counts = [int(labels.max()) + 1 if len(labels) else 0 for labels in (a, b)]
    return _consistency(*_common(a, b, area, *counts))


def _rand_error(faces: Int64, n: int) -> float:
    """Share of face pairs that are together in one alone; exact."""
    both = int((faces * faces).sum())
    in_a, in_b = (int((sums * sums).sum()) for sums in (faces.sum(axis=1), faces.sum(axis=0)))
    return (in_a + in_b - 2 * both) / (n * (n - 1)) if n > 1 else 0.0


def _consistency(faces: Int64, area: Float64) -> tuple[float, float]:
    n = int(faces.sum())
    if 1 in faces.shape or n in faces.shape or n == 0:
        return 0.0, 0.0
    tiny = np.finfo(np.float64).tiny
    # Share of each segment's area that the other's leaves out, for every cell.
    outside_b = 1.0 - area / np.maximum(area.sum(axis=1, keepdims=True), tiny)
    outside_a = 1.0 - area / np.maximum(area.sum(axis=0, keepdims=True), tiny)
    sums = [float((outside * faces).sum()) / n for outside in (outside_b, outside_a)]
    return min(sums), float((np.minimum(outside_b, outside_a) * faces).sum()) / n


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """Non-empty cells of the table of two partitions."""

    row: Int64
    """(C,) part of the first partition."""
    column: Int64
    """(C,) part of the second."""
    common: Float64
    """(C,) weight of the faces in both."""
    size_a: Float64
    """Weight of every part of the first partition."""
    size_b: Float64
    """Weight of every part of the second."""


def _table(labels_a: AnyInt, labels_b: AnyInt, weights: Float64 | None) -> _Table:
    if labels_a.shape != labels_b.shape or labels_a.ndim != 1:
        msg = f"labels have shapes {labels_a.shape} and {labels_b.shape}, expected two (F,)"
        raise ValueError(msg)
    if weights is not None:
        if weights.shape != labels_a.shape:
            msg = f"weights have shape {weights.shape}, expected {labels_a.shape}"
            raise ValueError(msg)
        if not (np.isfinite(weights) & (weights >= 0.0)).all():
            bad = int(np.flatnonzero(~(np.isfinite(weights) & (weights >= 0.0)))[0])
            msg = f"weight of face {bad} is {weights[bad]}, expected a finite number, 0 or more"
            raise ValueError(msg)
    dense_a = np.unique(labels_a, return_inverse=True)[1].astype(np.int64)
    dense_b = np.unique(labels_b, return_inverse=True)[1].astype(np.int64)
    width = int(dense_b.max()) + 1 if len(dense_b) else 1
    cells, cell = np.unique(dense_a * width + dense_b, return_inverse=True)
    common = np.bincount(cell, weights=weights, minlength=len(cells)).astype(np.float64)
    row, column = np.divmod(cells, width)
    size_a = np.bincount(row, weights=common).astype(np.float64)  # integer where there is no face
    size_b = np.bincount(column, weights=common).astype(np.float64)
    return _Table(row, column, common, size_a, size_b)


def _cut_discrepancy(mesh: MeshFacts, a: Pieces, b: Pieces) -> float:
    if len(a.cut) == 0 or len(b.cut) == 0 or mesh.radius <= 0.0:
        return float("nan")
    away = np.concatenate([b.distance[a.cut], a.distance[b.cut]])
    # A cut on a part of the mesh where the other has none is no distance from it.
    away = away[np.isfinite(away)]
    return float(away.mean()) / mesh.radius if len(away) else float("nan")


@numba.njit(cache=True)
def _common(a: Int32, b: Int32, area: Float64, count_a: int, count_b: int) -> tuple[Int64, Float64]:
    """Faces and area common to every two segments."""
    faces = np.zeros((count_a, count_b), np.int64)
    common = np.zeros((count_a, count_b), np.float64)
    for f in range(len(a)):
        faces[a[f], b[f]] += 1
        common[a[f], b[f]] += area[f]
    return faces, common
