"""A forest of decision trees as plain arrays: what it says of rows of features.

Grown elsewhere (scikit-learn: L. Breiman, "Random Forests", Machine Learning 45, 2001); here it is
only read, so that a model needs no library, and a file of it can be checked number by number.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.chunks import in_chunks

__all__ = ["Forest", "forest_fault"]

_ROWS: Final = 128
"""Of sixty features, 30 KiB: with a tree they fit into a core's own cache."""


@dataclass(frozen=True, slots=True, eq=False)
class Forest:
    """Trees one after the other; N nodes in all, C classes."""

    roots: Int64
    """(T,) first node of every tree, ascending."""
    left: Int32
    """(N,) node of rows whose feature is at most the threshold; -1 of a leaf."""
    right: Int32
    """(N,) node of the others; -1 of a leaf."""
    feature: Int32
    """(N,) column that is looked at; -1 of a leaf."""
    threshold: Float64
    """(N,)"""
    share: Float32
    """(N, C) of every class in a leaf; adds up to 1."""

    @property
    def classes(self) -> int:
        """Number of classes."""
        return int(self.share.shape[1])

    def predict(self, rows: Float32, *, threads: int = 1) -> Float32:
        """Say how likely every class is, (R, C): the mean of the trees' leaves."""
        out = np.zeros((len(rows), self.classes), np.float32)
        table = np.ascontiguousarray(rows, np.float32)
        in_chunks(
            lambda begin, end: _predict(
                self.roots, self.left, self.right, self.feature, self.threshold, self.share,
                table, out, begin, end,
            ),
            len(rows), threads=threads,
        )  # fmt: skip
        return out


def forest_fault(forest: Forest, features: int, classes: int) -> str | None:
    """Say what is wrong with a forest that was read; None where every row finds its leaves."""
    count = len(forest.left)
    sizes = (len(forest.right), len(forest.feature), len(forest.threshold), len(forest.share))
    if any(size != count for size in sizes):
        return f"nodes of {count}, {sizes} rows, expected equally many"
    if forest.share.ndim != 2 or forest.share.shape[1] != classes or classes < 1:
        return f"leaves of shape {forest.share.shape}, expected ({count}, {classes})"
    roots = forest.roots
    if not len(roots) or roots[0] != 0 or (np.diff(roots) <= 0).any() or roots[-1] >= count:
        return "roots that do not ascend from 0 within the nodes"
    node = np.arange(count)
    is_leaf = forest.left < 0
    inner = ~is_leaf
    if (is_leaf != (forest.right < 0)).any() or (is_leaf != (forest.feature < 0)).any():
        return "nodes that are leaves on one side alone"
    # Children come after their parent and within its tree: no row walks for ever.
    end = np.append(roots[1:], count)[np.searchsorted(roots, node, side="right") - 1]
    for children in (forest.left, forest.right):
        if (inner & ((children <= node) | (children >= end))).any():
            return "a child that does not come after its node within the tree"
    if (forest.feature[inner] >= features).any():
        return f"a feature beyond the {features}"
    if not np.isfinite(forest.threshold[inner]).all():
        return "a threshold that is no number"
    shares = forest.share[is_leaf]
    if not (np.isfinite(shares).all() and (shares >= 0).all()):
        return "a leaf with shares below 0 or that are no numbers"
    if np.abs(shares.sum(axis=1) - 1.0).max(initial=0.0) > 1e-3:
        return "a leaf whose shares do not add up to 1"
    return None


@numba.njit(cache=True, nogil=True)
def _predict(
    roots: Int64,
    left: Int32,
    right: Int32,
    feature: Int32,
    threshold: Float64,
    share: Float32,
    rows: Float32,
    out: Float32,
    begin: int,
    end: int,
) -> None:
    # Some rows at a time go through one tree after the other: a tree stays in the nearest cache for
    # all of them, where a row at a time would fetch the whole forest anew. Each row adds its leaves
    # in the order of the trees either way.
    for first in range(begin, end, _ROWS):
        last = min(first + _ROWS, end)
        for root in roots:
            for row in range(first, last):
                node = root
                while left[node] >= 0:
                    is_left = rows[row, feature[node]] <= threshold[node]
                    node = left[node] if is_left else right[node]
                for kind in range(share.shape[1]):
                    out[row, kind] += share[node, kind]
        for row in range(first, last):
            for kind in range(share.shape[1]):
                out[row, kind] /= len(roots)
