"""Which regions of a new surface are the same pieces of ground as regions of an older one.

Both surfaces are given as samples, each standing for some area. A sample's counterpart is the
nearest sample of the other surface; area whose counterpart is nearer than a limit is common to the
two regions. A pair's similarity is the intersection over union of its areas (P. Jaccard, 1912).
Pairs are taken greedily, most similar first, each region at most once.

Why greedy, and not the assignment of greatest total similarity (H. W. Kuhn, "The Hungarian method",
1955)? Above one half the two agree, since no region can have two partners (A. Kirillov et al.,
"Panoptic Segmentation", CVPR 2019, section 4.1). Below it, the best total may give a region's best
partner to another to win a little elsewhere: a chain of renamed regions from one small change far
away. A person would name the pair that is most alike first.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import AnyInt, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.surface_samples import SurfaceSamples

__all__ = [
    "MIN_SIMILARITY",
    "CommonGround",
    "Overlaps",
    "carry_ids",
    "match_regions",
    "region_overlaps",
]


MIN_SIMILARITY: Final = 0.3
"""Intersection over union from which two regions may be the same. Two regions of one size that have
half of themselves in common reach 1/3. Higher, and a stockpile that grew by half over the year is a
new one; lower, and a crumb inherits the label of the whole."""

_REACH_SPACINGS: Final = 3.0
"""Default limit of distance in spacings of the sparser samples: a point of an evenly sampled
surface lies within 0.7 spacings of a sample; the rest is for uneven faces and new noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """Pairs of regions that share area; one row per pair, by new then old region."""

    new: Int32
    """(K,) region of the new surface."""
    old: Int32
    """(K,) region of the old surface."""
    area: Float64
    """(K,) square metres in common, > 0."""
    similarity: Float64
    """(K,) area in common over area of both together, 0..1."""


@dataclass(frozen=True, slots=True, eq=False)
class CommonGround:
    """Pieces that are in both surfaces, bit for bit."""

    new: Int32
    """(P,) region of every piece in the new surface."""
    old: Int32
    """(P,) and in the old."""
    area: Float64
    """(P,) square metres."""

    @classmethod
    def none(cls) -> CommonGround:
        """Two surfaces of which nothing is known to be the same."""
        return cls(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0))


def region_overlaps(
    new: SurfaceSamples,
    old: SurfaceSamples,
    *,
    common: CommonGround | None = None,
    max_distance_m: float | None = None,
) -> Overlaps:
    """Measure what each region of the new surface shares with each of the old.

    Parameters
    ----------
    new, old : SurfaceSamples
        Of both surfaces, in one frame, without the common ground; the labels are regions.
    common : CommonGround, optional
        What need not be sampled.
    max_distance_m : float, optional
        Farther apart is not the same place. By default three spacings of the sparser samples.

    Returns
    -------
    Overlaps
        A pair's area is the mean of what the new surface finds on the old and the old on the new,
        so no more than the mean of the two regions' areas: the similarity never exceeds 1. Which
        sample is nearest is decided by SciPy's tree where two are equally far.
    """
    common = CommonGround.none() if common is None else common
    # (1) Area of every region: of its samples, and of what is common ground.
    new_labels, old_labels = (
        np.concatenate([samples.labels, pieces])
        for samples, pieces in ((new, common.new), (old, common.old))
    )
    old_count = int(old_labels.max(initial=-1)) + 1
    new_area = np.bincount(new_labels, np.concatenate([new.areas, common.area]))
    old_area = np.bincount(old_labels, np.concatenate([old.areas, common.area]))
    # (2) Area of every pair, each surface's samples against the other's.
    keys = [common.new.astype(np.int64) * np.int64(old_count) + common.old]
    areas = [common.area]
    both_ways = ((new, old), (old, new)) if len(new.labels) and len(old.labels) else ()
    for here, there in both_ways:
        limit = (
            _REACH_SPACINGS * max(_spacing(new), _spacing(old))
            if max_distance_m is None
            else max_distance_m
        )
        distance, nearest = cKDTree(there.points).query(
            here.points, distance_upper_bound=np.nextafter(limit, np.inf)
        )
        met = np.isfinite(distance)
        mine, theirs = here.labels[met].astype(np.int64), there.labels[nearest[met]]
        a, b = (mine, theirs) if here is new else (theirs, mine)
        keys.append(a * np.int64(old_count) + b)
        areas.append(0.5 * here.areas[met])
    pairs, row = np.unique(np.concatenate(keys), return_inverse=True)
    shared = np.bincount(row, np.concatenate(areas), len(pairs)).astype(np.float64)
    pairs, shared = pairs[shared > 0.0], shared[shared > 0.0]
    # (3) Each direction finds at most its own region's area, so shared <= both / 2 but for
    # rounding.
    a, b = np.divmod(pairs, max(old_count, 1))
    both = new_area[a] + old_area[b]
    similarity = np.minimum(shared / np.maximum(both - shared, 0.5 * both), 1.0)
    return Overlaps(a.astype(np.int32), b.astype(np.int32), shared, similarity)


def match_regions(
    overlaps: Overlaps, *, min_similarity: float = MIN_SIMILARITY
) -> tuple[Int32, Int32]:
    """Choose which regions are the same, one to one.

    Parameters
    ----------
    overlaps : Overlaps
    min_similarity : float, optional
        Pairs below it are not the same.

    Returns
    -------
    new, old : ndarray of shape (M,), int32
        Matched regions, by new region. Most similar pairs first; of equals the one with more area
        in common, then the lower old region, then the lower new region.
    """
    good = np.flatnonzero(overlaps.similarity >= min_similarity)
    order = good[
        np.lexsort(
            (
                overlaps.new[good],
                overlaps.old[good],
                -overlaps.area[good],
                -overlaps.similarity[good],
            )
        )
    ]
    partner: dict[int, int] = {}
    taken: set[int] = set()
    # Pairs, not faces: at most 1 / min_similarity of them per region can be good.
    for new, old in zip(overlaps.new[order].tolist(), overlaps.old[order].tolist(), strict=True):
        if new not in partner and old not in taken:
            partner[new] = old
            taken.add(old)
    matched = sorted(partner.items())
    return (
        np.array([new for new, _ in matched], np.int32),
        np.array([old for _, old in matched], np.int32),
    )


def carry_ids(
    region_count: int,
    matched: tuple[Int32, Int32],
    old_ids: AnyInt,
    first_free: int,
) -> tuple[Int64, int]:
    """Give matched regions their old numbers and all others numbers never used before.

    Parameters
    ----------
    region_count : int
        Regions of the new surface.
    matched : pair of ndarray of shape (M,), int32
        New and old regions that are the same; see :func:`match_regions`.
    old_ids : ndarray of shape (O,), integer
        Number of every old region, all different, all below `first_free`.
    first_free : int
        Lowest number that was never used.

    Returns
    -------
    ids : ndarray of shape (region_count,), int64
        All different.
    first_free : int
        Lowest number that is still unused. Numbers of old regions without a partner stay retired.

    Examples
    --------
    >>> ids, free = carry_ids(3, (np.array([2]), np.array([0])), np.array([7, 8]), 9)
    >>> ids.tolist(), free
    ([9, 10, 7], 11)
    """
    ids: Int64 = np.full(region_count, -1, np.int64)
    ids[matched[0]] = old_ids[matched[1]]
    fresh = np.flatnonzero(ids < 0)
    ids[fresh] = first_free + np.arange(len(fresh))
    return ids, first_free + len(fresh)


def _spacing(samples: SurfaceSamples) -> float:
    """Side of the square that a sample stands for on average."""
    return float(np.sqrt(samples.areas.sum() / len(samples.areas)))
