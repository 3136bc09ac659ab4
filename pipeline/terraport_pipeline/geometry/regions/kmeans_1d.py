"""k-means of numbers on a line: exact, deterministic, without a start or a seed.

On a line every optimal cluster is an interval of the sorted values, so the best partition is found
by dynamic programming instead of Lloyd's iterations from random centres. Up to ``EXACT_VALUES``
distinct values the result is the global optimum. Beyond it the values are first counted into
``HISTOGRAM_BINS`` bins, the optimum over bins is found, and sorted Lloyd steps on the real values
polish its borders (measured on 12 M values, k = 500: sum of squares 110.9 with 4 096 bins, 109.7
with 65 536, against 497 for 2 000 Lloyd steps from quantiles).

PURE: no I/O, no clock.

References
----------
H. Wang, M. Song, "Ckmeans.1d.dp: optimal k-means clustering in one dimension by dynamic
programming", The R Journal 3(2), 2011; the row minima are found by divide and conquer (the cost
matrix is totally monotone).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["EXACT_VALUES", "HISTOGRAM_BINS", "MAX_EXACT_CLUSTERS", "Clusters1D", "kmeans_1d"]

EXACT_VALUES: Final = 4096
"""Distinct values up to which the optimum is exact."""
HISTOGRAM_BINS: Final = 8192
"""Bins beyond that; between the 4 096 and 16 384 measured to lose less than 1.2 % of the sum of
squares."""
MAX_EXACT_CLUSTERS: Final = 1024
"""Above this many clusters the dynamic programme's table (clusters x bins) is refused and Lloyd
steps start from equal-count intervals; such k only arise from thresholds far below any useful
one."""
_MAX_POLISH_STEPS: Final = 100
_TIE: Final = 1e-12
"""A split must beat another by this share of the total sum of squares, else the leftmost wins:
rounding decides no tie."""


@dataclass(frozen=True, slots=True, eq=False)
class Clusters1D:
    """Result of :func:`kmeans_1d`: upper borders and means of the clusters, ascending."""

    upper: Float32
    """(k,) float32: largest value of each cluster."""
    means: Float64
    """(k,) float64: mean value of each cluster."""

    def assign(self, values: Float32, *, threads: int = 1) -> Int32:
        """Cluster number of every value: the first cluster whose largest value is not below it."""
        labels = np.empty(len(values), np.int32)
        given, upper = as_kernel_input(values, np.float32), as_kernel_input(self.upper, np.float32)
        in_chunks(
            lambda begin, end: _assign(given, upper, labels, begin, end),
            len(values), threads=threads,
        )  # fmt: skip
        return labels


def kmeans_1d(ordered: Float32, k: int) -> Clusters1D:
    """Partition sorted values into k clusters of least squared distance to their means.

    Parameters
    ----------
    ordered : ndarray of shape (N,), float32
        Ascending, finite, N >= 1.
    k : int
        Number of clusters, >= 1. With fewer distinct values, every distinct value is its own
        cluster.

    Returns
    -------
    Clusters1D
        ``min(k, distinct values)`` clusters. Equal values are always in one cluster. Tie rule: of
        several optimal partitions, the one whose last border lies leftmost, then the one before it,
        and so on.

    Raises
    ------
    ValueError
        No values, k < 1, or values that are not ascending.

    Examples
    --------
    >>> clusters = kmeans_1d(np.array([0, 1, 9, 10, 11], dtype=np.float32), 2)
    >>> clusters.means.tolist(), clusters.assign(np.array([9, 0], dtype=np.float32)).tolist()
    ([0.5, 10.0], [1, 0])
    """
    # (1) Equal values stay together, so there are no more clusters than distinct values.
    if len(ordered) == 0 or k < 1:
        msg = f"received {len(ordered)} values and k = {k}, expected at least one of each"
        raise ValueError(msg)
    values = as_kernel_input(ordered, np.float32)
    distinct, bad = _count_distinct(values)
    if bad >= 0:
        msg = f"value {bad} is {ordered[bad]} after {ordered[bad - 1]}, expected ascending"
        raise ValueError(msg)
    k = min(k, distinct)
    # (2) Exact where that is affordable; else exact on a histogram, or an even start, and polished
    # from there.
    if distinct <= EXACT_VALUES and k <= MAX_EXACT_CLUSTERS:
        firsts = _firsts(values)
        starts = firsts[_optimal_starts(*_grouped(values, firsts), k)]
    else:
        if k > MAX_EXACT_CLUSTERS:
            starts = _firsts(values)[np.arange(k) * distinct // k]
        else:
            low, high = float(values[0]), float(values[-1])
            borders = low + (high - low) * np.arange(1, HISTOGRAM_BINS) / HISTOGRAM_BINS
            cuts = np.searchsorted(values, borders.astype(np.float32), side="left")
            bins = np.unique(np.concatenate([[0], cuts[cuts < len(values)]])).astype(np.int64)
            k_bins = min(k, len(bins))
            starts = bins[_optimal_starts(*_grouped(values, bins), k_bins)]
        starts = _polish(values, starts)
    # (3) Borders and means of the runs.
    ends = np.append(starts[1:], len(values))
    _, sums, _ = _grouped_sums(values, starts, 0.0)
    return Clusters1D(ordered[ends - 1].copy(), sums / (ends - starts))


def _firsts(ordered: Float32) -> Int64:
    """Positions where a value differs from the one before."""
    steps = ordered[1:] > ordered[:-1]
    return np.concatenate([[0], np.flatnonzero(steps) + 1]).astype(np.int64)


def _grouped(ordered: Float32, starts: Int64) -> tuple[Float64, Float64, Float64]:
    """Count, sum and sum of squares per group, about the overall mean for accuracy."""
    mean = float(ordered.mean(dtype=np.float64))
    return _grouped_sums(ordered, starts, mean)


@numba.njit(cache=True, nogil=True)
def _count_distinct(ordered: Float32) -> tuple[int, int]:
    """Count the distinct values; and the first value below the one before it (or nan), or -1."""
    count = 1
    for i in range(1, len(ordered)):
        if ordered[i] > ordered[i - 1]:
            count += 1
        elif ordered[i] != ordered[i - 1]:  # also where one is nan
            return count, i
    return count, -1


@numba.njit(cache=True, nogil=True)
def _grouped_sums(
    ordered: Float32, starts: Int64, about: float
) -> tuple[Float64, Float64, Float64]:
    n = len(starts)
    counts, sums, squares = np.zeros(n), np.zeros(n), np.zeros(n)
    for g in range(n):
        end = starts[g + 1] if g + 1 < n else len(ordered)
        for i in range(starts[g], end):
            value = np.float64(ordered[i]) - about
            sums[g] += value
            squares[g] += value * value
        counts[g] = end - starts[g]
    return counts, sums, squares


@numba.njit(cache=True, nogil=True)
def _assign(values: Float32, upper: Float32, labels: Int32, begin: int, end: int) -> None:
    for i in range(begin, end):
        low, high = 0, len(upper) - 1
        while low < high:
            middle = (low + high) // 2
            if upper[middle] < values[i]:
                low = middle + 1
            else:
                high = middle
        labels[i] = low


@numba.njit(cache=True, nogil=True)
def _cost(n: Float64, s: Float64, q: Float64, i: int, j: int) -> float:
    """Sum of squares of groups i..j-1 about their mean, from prefix sums."""
    total = s[j] - s[i]
    return float(max(q[j] - q[i] - total * total / (n[j] - n[i]), 0.0))


@numba.njit(cache=True, nogil=True)
def _optimal_starts(counts: Float64, sums: Float64, squares: Float64, k: int) -> Int64:
    """First group of each cluster in the optimal partition of m groups into k <= m clusters."""
    # (1) Prefix sums: the cost of any run of groups in O(1).
    m = len(counts)
    n = np.zeros(m + 1)
    s = np.zeros(m + 1)
    q = np.zeros(m + 1)
    for i in range(m):
        n[i + 1] = n[i] + counts[i]
        s[i + 1] = s[i] + sums[i]
        q[i + 1] = q[i] + squares[i]
    margin = _TIE * _cost(n, s, q, 0, m)
    # (2) One cluster: the cost of the first j groups together.
    best = np.empty(m + 1)
    best[0] = 0.0
    for j in range(1, m + 1):
        best[j] = _cost(n, s, q, 0, j)
    split = np.zeros((k, m + 1), np.int32)
    stack = np.empty((4 * 64, 4), np.int64)
    # (3) One cluster more at a time. Invariant: `best[j]` is the least cost of the first j groups
    # in c clusters, `split[c, j]` the first group of the last of c + 1 clusters among them.
    for c in range(1, k):
        row = np.full(m + 1, np.inf)
        # Divide and conquer over j: the leftmost best split never moves left as j grows.
        stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = c + 1, m, c, m - 1
        depth = 1
        while depth:
            depth -= 1
            lo, hi = stack[depth, 0], stack[depth, 1]
            split_lo, split_hi = stack[depth, 2], stack[depth, 3]
            if lo > hi:
                continue
            mid = (lo + hi) // 2
            chosen = -1
            lowest = np.inf
            for i in range(max(split_lo, c), min(split_hi, mid - 1) + 1):
                cost = best[i] + _cost(n, s, q, i, mid)
                if chosen < 0 or cost < lowest - margin:
                    lowest = cost
                    chosen = i
            row[mid] = lowest
            split[c, mid] = chosen
            stack[depth, 0], stack[depth, 1] = lo, mid - 1
            stack[depth, 2], stack[depth, 3] = split_lo, chosen
            depth += 1
            stack[depth, 0], stack[depth, 1] = mid + 1, hi
            stack[depth, 2], stack[depth, 3] = chosen, split_hi
            depth += 1
        best = row
    # (4) Back from the end: the split of all groups, then that of the groups before it.
    starts = np.zeros(k, np.int64)
    j = m
    for c in range(k - 1, 0, -1):
        j = split[c, j]
        starts[c] = j
    return starts


def _polish(ordered: Float32, starts: Int64) -> Int64:
    """Lloyd steps on sorted values until the borders rest; a cluster never becomes empty."""
    prefix = np.zeros(len(ordered) + 1)
    np.cumsum(ordered, dtype=np.float64, out=prefix[1:])
    for _ in range(_MAX_POLISH_STEPS):
        ends = np.append(starts[1:], len(ordered))
        means = (prefix[ends] - prefix[starts]) / (ends - starts)
        middles = ((means[1:] + means[:-1]) * 0.5).astype(np.float32)
        # Equal to the middle -> lower cluster; means lie inside their intervals, so borders stay
        # ascending.
        moved = np.concatenate([[0], np.searchsorted(ordered, middles, side="right")])
        moved = np.unique(moved[moved < len(ordered)]).astype(np.int64)
        if len(moved) == len(starts) and (moved == starts).all():
            break
        starts = moved
    return starts
