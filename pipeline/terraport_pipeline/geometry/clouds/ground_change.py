"""Which ground changed between two surveys of it: cubes first, then the blocks that hold them.

A cube changed where the surveys lie apart beyond doubt, where one has ground and the other none
near, or where the colour is another. Thousands of cubes are compared, so *beyond doubt* means five
standard deviations and a fair part of a spacing, and a cube counts only with two more that touch:
an outlier, a bush that was sampled otherwise and the rim of a survey are not a change of ground.
Around cubes that changed, those that touch them are renewed, too: a change runs out there in a toe
too thin to be measured, and a seam between old and new samples should not lie on it.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from terraport_payload.types import AnyInt, Bool, Float32, Float64, Int64
from terraport_pipeline.geometry.clouds.ground_cells import (
    COLOUR,
    COUNT,
    KEY_BITS,
    SQUARE,
    GroundSums,
    key_indices,
)
from terraport_pipeline.geometry.clouds.ground_distance import LEAST, measure_ground
from terraport_pipeline.geometry.mesh.chunks import in_chunks

__all__ = ["GroundChange", "GroundScale", "block_keys", "find_changes"]

_SURE: Final = 5.0
"""Standard deviations from which a change is beyond doubt."""

_LEAST_SPACINGS: Final = 0.3
"""A surface is solved in cells of 1.2 spacings: what is less than a quarter of that hardly shows,
and is as much as two surveys that are tied to the same control points may be apart."""

_LEAST_SCATTER: Final = 0.5
"""Of the scatter that noise does not explain: over an edge or rubble the mean moves with how the
samples happen to be spread."""

_REGISTRATION_SPACINGS: Final = 0.1
_REGISTRATION_NOISE: Final = 0.5
"""How far two surveys are apart throughout, at least: a photogrammetric survey is tied to its
control points about as well as its points are to their surface."""

_REACH_SPACINGS: Final = 3.0
_REACH_NOISE: Final = 2.0
"""Ground is gone, or new, beyond this distance to all samples of the other survey."""

_LEAST_VOXELS: Final = 5
"""Voxels of such ground from which a cube changed, of 16 to 25 that a surface fills. Twigs and the
rim of a survey fill fewer."""

_LEAST_CUBES: Final = 3
"""Cubes that touch each other: less is chance."""

_LEAST_LEVELS: Final = 12.0
"""Of 255, by which the mean colour differs where ground was painted, wetted or heaped with other
material. Clouds before the sun do less once the gain is out."""

_GAIN_LEVELS: Final = (16.0, 240.0)
"""Means between these tell the gain: darker ones are noise, brighter ones are cut off."""

_DENSITY_SAMPLES: Final = 64
"""Of a block whose densities are compared, at least; a few hundred are usual."""

_GAIN_CUBES: Final = 500_000
"""Cubes that tell the gain, at most: every n-th of more."""

_STEPS: Final = np.array(
    [
        (x << (2 * KEY_BITS)) + (y << KEY_BITS) + z
        for x, y, z in itertools.product((-1, 0, 1), repeat=3)
        if (x, y, z) != (0, 0, 0)
    ],
    dtype=np.int64,
)
"""From a key to those of the 26 cubes that touch its cube."""


@dataclass(frozen=True, slots=True)
class GroundScale:
    """What lengths are measured against."""

    width_m: float
    """Of a cube."""
    spacing_m: float
    """Root of the area that a sample stands for."""
    noise_m: float
    """Standard deviation of the samples across their surface."""

    @property
    def registration_m(self) -> float:
        """How far two surveys may be apart throughout without a change."""
        return _REGISTRATION_SPACINGS * self.spacing_m + _REGISTRATION_NOISE * self.noise_m

    @property
    def reach_m(self) -> float:
        """Ground is gone, or new, beyond this distance to the other survey's samples."""
        return _REACH_SPACINGS * self.spacing_m + _REACH_NOISE * self.noise_m


@dataclass(frozen=True, slots=True, eq=False)
class GroundChange:
    """What changed; cubes in the order of their keys."""

    moved: Bool
    """(K,) the ground lies elsewhere, is gone or is new."""
    painted: Bool
    """(K,) its colour is another."""
    shifted: Bool
    """(K,) it moved, or touches a cube that did."""
    renewed: Bool
    """(K,) it moved or is painted, or touches a cube that is so by itself (not by its block's
    mean)."""
    gains: Float64
    """(3,) of red, green and blue, where nothing changed: the second survey's over the first's."""
    shift_m: float
    """Median distance where both have ground: how far the surveys are apart throughout."""
    density_ratio: float
    """Samples of the second survey over those of the first: median of the blocks with both."""


def block_keys(keys: Int64, cubes: int) -> Int64:
    """Return the key of the block, so many cubes wide, that each cube lies in."""
    index = key_indices(keys) // cubes + (1 << (KEY_BITS - 1))
    packed: Int64 = (((index[:, 0] << KEY_BITS) | index[:, 1]) << KEY_BITS) | index[:, 2]
    return packed


def find_changes(
    keys: Int64,
    blocks: AnyInt,
    before: GroundSums,
    after: GroundSums,
    scale: GroundScale,
    *,
    has_colour: bool = True,
    threads: int = 1,
) -> GroundChange:
    """Compare two surveys of one ground.

    Parameters
    ----------
    keys : ndarray of shape (K,), int64
        Of the cubes that hold samples of either, sorted.
    blocks : ndarray of shape (K,), integer
        Number of the block that each lies in, from 0.
    before, after : GroundSums
        For these cubes. Exchanged, they give the same changes.
    scale : GroundScale
    has_colour : bool
        Colours were summed, too.
    threads : int
        The answer does not depend on it.

    Returns
    -------
    GroundChange
    """
    # (1) Ground that lies elsewhere, is gone or is new.
    moved, shift_m = _ground_changes(keys, before, after, scale, threads)
    density = _density_ratio(blocks, before, after)
    # (2) Ground of another colour.
    gains = np.ones(3)
    painted, tinged = np.zeros((2, len(keys)), dtype=bool)
    if has_colour:
        gains, painted, tinged = _colour_changes(blocks, before, after, ~moved, threads)
    # (3) Not by chance alone: with others that touch. Then what touches these.
    sure = _clustered(keys, moved | painted)
    moved &= sure
    painted &= sure
    shifted = _touching(keys, moved)
    renewed = shifted | _touching(keys, painted) | tinged
    return GroundChange(moved, painted | tinged, shifted, renewed, gains, shift_m, density)


def _ground_changes(
    keys: Int64, before: GroundSums, after: GroundSums, scale: GroundScale, threads: int
) -> tuple[Bool, float]:
    """Mark cubes whose ground is another; tell the median distance, metres."""
    width_m = scale.width_m
    measured = measure_ground(keys, before, after, reach=scale.reach_m / width_m, threads=threads)
    rough = np.sqrt(np.maximum(measured.scatter**2 - (scale.noise_m / width_m) ** 2, 0.0))
    limit = _SURE * measured.error + scale.registration_m / width_m
    limit = np.maximum(limit, _LEAST_SPACINGS * scale.spacing_m / width_m)
    limit = np.maximum(limit, _LEAST_SCATTER * rough)
    moved = np.abs(measured.distance) > limit  # False where it is not known
    moved |= (measured.lost >= _LEAST_VOXELS) | (measured.gained >= _LEAST_VOXELS)
    known = measured.distance[~np.isnan(measured.distance)]
    return moved, float(np.median(known)) * width_m if len(known) else 0.0


def _density_ratio(blocks: AnyInt, before: GroundSums, after: GroundSums) -> float:
    """Median over blocks: cubes of a thin survey are empty by chance, blocks are not."""
    counts = [np.bincount(blocks, ground.sums[:, COUNT]) for ground in (before, after)]
    both = (np.minimum(*counts) > 0) & (np.add(*counts) >= _DENSITY_SAMPLES)
    ratio = np.log(counts[1][both] / counts[0][both])
    return float(np.exp(np.median(ratio))) if len(ratio) else 1.0


def _touching(keys: Int64, marked: Bool) -> Bool:
    """Mark cubes that are marked and those that touch them."""
    wider = marked.copy()
    for step in _STEPS:
        near = keys[marked] + step
        at = np.searchsorted(keys, near)
        at[at == len(keys)] = 0
        wider[at[keys[at] == near]] = True
    return wider


def _clustered(keys: Int64, marked: Bool) -> Bool:
    """Of marked cubes, those that hang together in groups that are large enough."""
    rows = np.flatnonzero(marked)
    if not len(rows):
        return marked
    some = keys[rows]
    pairs = []
    for step in _STEPS[len(_STEPS) // 2 :]:
        at = np.minimum(np.searchsorted(some, some + step), len(some) - 1)
        touching = np.flatnonzero(some[at] == some + step)
        pairs.append(np.stack([touching, at[touching]]))
    first, second = np.concatenate(pairs, axis=1)
    links = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(len(some),) * 2)
    _, group = connected_components(links, directed=False)
    clustered = np.zeros_like(marked)
    clustered[rows] = np.bincount(group)[group] >= _LEAST_CUBES
    return clustered


def _colour_changes(
    blocks: AnyInt, before: GroundSums, after: GroundSums, still: Bool, threads: int
) -> tuple[Float64, Bool, Bool]:
    """Find gains, cubes whose colour differs beyond them, and those of blocks whose mean does."""
    both = (before.sums[:, COUNT] >= LEAST) & (after.sums[:, COUNT] >= LEAST)
    rows = np.flatnonzero(both & still)
    painted, tinged = np.zeros((2, len(both)), dtype=bool)
    if not len(rows):
        return np.ones(3), painted, tinged
    # (1) One gain per channel. Of logarithms, so that exchanged surveys give its inverse.
    logarithms = []
    some = rows[:: -(-len(rows) // _GAIN_CUBES)]
    for channel in range(3):
        old, new = _mean(before, channel, some), _mean(after, channel, some)
        dark, bright = _GAIN_LEVELS
        clear = (np.minimum(old, new) >= dark) & (np.maximum(old, new) <= bright)
        ratio = np.log(new[clear] / old[clear])
        logarithms.append(float(np.median(ratio)) if len(ratio) else 0.0)
    gains = np.exp(logarithms)
    # (2) What is left, cube by cube: half of the gain is taken from either survey.
    rows = np.flatnonzero(both).astype(np.int32)
    steps = np.empty((len(rows), 3), np.float32)
    variance = np.empty(len(rows), np.float32)

    def work(begin: int, end: int) -> None:
        some = rows[begin:end]
        for channel, gain in enumerate(np.sqrt(gains)):
            old, new = _mean(before, channel, some), _mean(after, channel, some)
            steps[begin:end, channel] = new / gain - old * gain
        variance[begin:end] = _variance(before, some) + _variance(after, some)
        levels = np.abs(steps[begin:end]).max(axis=1)
        painted[some] = levels > _LEAST_LEVELS + _SURE * np.sqrt(variance[begin:end])

    in_chunks(work, len(rows), threads=threads)
    # (3) And block by block, whose mean shows what single cubes leave in doubt.
    block = blocks[rows]
    count = np.maximum(np.bincount(block), 1)
    error = np.sqrt(np.bincount(block, variance)) / count
    strongest = np.max([np.abs(np.bincount(block, step)) / count for step in steps.T], axis=0)
    tinged[rows] = (strongest > _LEAST_LEVELS + _SURE * error)[block]
    return gains, painted, tinged


def _mean(ground: GroundSums, channel: int, rows: AnyInt) -> Float32:
    mean: Float32 = (
        ground.sums[rows, COLOUR + channel] / ground.sums[rows, COUNT].astype(np.float64)
    ).astype(np.float32)
    return mean


def _variance(ground: GroundSums, rows: AnyInt) -> Float64:
    """Of a channel's mean: a third of all channels' scatter, over the samples."""
    sums = ground.sums[rows].astype(np.float64)
    count = sums[:, COUNT]
    squares = 16.0 * sums[:, SQUARE] - (sums[:, COLOUR:SQUARE] ** 2).sum(axis=1) / count
    variance: Float64 = np.maximum(squares, 0.0) / (3.0 * count * (count - 1.0))
    return variance
