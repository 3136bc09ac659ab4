"""TPA as a page of plain NumPy and SciPy says it: what compiled kernels are to be compared with.

The steps of :mod:`terraport_pipeline.geometry.regions.triangle_pool`, each by the library calls
that come to mind: gathers and means, ``np.sort``, edges by ``np.lexsort``, connected components of
SciPy. Two things differ: k-means is Lloyd's from quantiles instead of exact, and a small pool that
touches no large one in any round stays. One thread.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from terraport_payload.types import AnyArray, Float32, Float64, Int32, UInt8
from terraport_pipeline.geometry.regions.engine_options import TrianglePoolOptions

__all__ = ["plain_pools"]

_WHITE: AnyArray = np.array([0.95047, 1.0, 1.08883])
_TO_XYZ: AnyArray = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


def plain_pools(
    vertices: Float32, faces: Int32, colours: UInt8, options: TrianglePoolOptions
) -> Int32:
    """Pool of every face, (F,) int32."""
    # (1) Index, distance, similarity.
    index = _to_white(colours[faces].mean(axis=1))
    centres = vertices[faces].astype(np.float64).mean(axis=1)
    distance = np.linalg.norm(centres - centres.min(axis=0), axis=1)
    index = (index - index.min()) / (index.max() - index.min())
    s = (options.mu * index + options.tau * distance / distance.max()).astype(np.float32)
    # (2) k by chaining, level 2 by Lloyd's k-means in one dimension.
    ordered = np.sort(s)
    k, first = 0, -np.inf
    while True:
        at = np.searchsorted(ordered, np.float32(first + options.threshold), side="right")
        if k and at >= len(ordered):
            break
        first = float(ordered[at if k else 0])
        k += 1
    level2 = _lloyd(ordered, s, k)
    # (3) Level 3: faces over common edges, by sorted edges.
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    face = np.tile(np.arange(len(faces), dtype=np.int32), 3)
    order = np.lexsort((face, edges[:, 1], edges[:, 0]))
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    a, b = face[order[:-1]][same], face[order[1:]][same]
    alike = level2[a] == level2[b]
    graph = coo_matrix(
        (np.ones(int(alike.sum()), np.int8), (a[alike], b[alike])), shape=(len(faces),) * 2
    )
    count, level3 = connected_components(graph, directed=False)
    # (4) Small pools join the touching large one of the nearest mean, round by round.
    size = np.bincount(level3, minlength=count)
    mean = np.bincount(level3, s, count) / size
    target = np.where(size >= options.small_threshold * len(faces), np.arange(count), -1)
    touching = np.unique(np.stack([level3[a], level3[b]], axis=1), axis=0)
    touching = np.concatenate([touching, touching[:, ::-1]])
    while True:
        small, near = touching[(target[touching[:, 0]] < 0) & (target[touching[:, 1]] >= 0)].T
        if not len(small):
            break
        reached = target[near]
        far = np.abs(mean[small] - mean[reached])
        best = np.lexsort((reached, far, small))
        first_of = np.unique(small[best], return_index=True)[1]
        target[small[best][first_of]] = reached[best][first_of]
    target = np.where(target < 0, np.arange(count), target)
    labels: Int32 = np.unique(target[level3], return_inverse=True)[1].astype(np.int32)
    return labels


def _lloyd(ordered: Float32, s: Float32, k: int, rounds: int = 50) -> AnyArray:
    means: Float64 = np.quantile(ordered, (np.arange(k) + 0.5) / k).astype(np.float64)
    total = np.concatenate([[0.0], np.cumsum(ordered, dtype=np.float64)])
    for _ in range(rounds):
        cuts = np.searchsorted(ordered, 0.5 * (means[1:] + means[:-1]))
        ends = np.concatenate([[0], cuts, [len(ordered)]])
        new = np.diff(total[ends]) / np.maximum(np.diff(ends), 1)
        if np.allclose(new, means, rtol=0, atol=1e-9):
            break
        means = np.sort(new)
    return np.searchsorted(0.5 * (means[1:] + means[:-1]), s)


def _to_white(srgb: Float64) -> Float64:
    """CIEDE2000 to white: of L* and chroma alone, as white has no hue (Sharma 2005)."""
    share = srgb / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    t = (light @ _TO_XYZ.T) / _WHITE
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    lightness = 116 * f[:, 1] - 16
    a, b = 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])
    half = 0.5 * np.hypot(a, b)
    g = 0.5 * (1 - np.sqrt(half**7 / (half**7 + 25.0**7)))
    chroma = np.hypot((1 + g) * a, b)
    middle = 0.5 * (lightness + 100) - 50
    s_l = 1 + 0.015 * middle**2 / np.sqrt(20 + middle**2)
    s_c = 1 + 0.045 * 0.5 * chroma
    found: Float64 = np.hypot((lightness - 100) / s_l, chroma / s_c)
    return found
