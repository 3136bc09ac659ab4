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

from terraport_payload.types import Bool, Float32, Float64, Int64
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

__all__ = ["CONFIDENCE", "GroundChange", "GroundScale", "block_keys", "find_changes"]

CONFIDENCE: Final = 1.96
"""Standard deviations of a level of detection at 95 %."""

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
    renewed: Bool
    """(K,) either of these, or it touches a cube that is."""
    gains: Float64
    """(3,) of red, green and blue, where nothing changed: the second survey's over the first's."""
    shift_m: float
    """Median distance where both have ground: how far the surveys are apart throughout."""


def block_keys(keys: Int64, cubes: int) -> Int64:
    """Return the key of the block, so many cubes wide, that each cube lies in."""
    index = key_indices(keys) // cubes + (1 << (KEY_BITS - 1))
    packed: Int64 = (((index[:, 0] << KEY_BITS) | index[:, 1]) << KEY_BITS) | index[:, 2]
    return packed


def find_changes(
    keys: Int64,
    blocks: Int64,
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
    blocks : ndarray of shape (K,), int64
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
    width_m = scale.width_m
    measured = measure_ground(keys, before, after, reach=scale.reach_m / width_m, threads=threads)
    rough = np.sqrt(np.maximum(measured.scatter**2 - (scale.noise_m / width_m) ** 2, 0.0))
    limit = _SURE * measured.error + scale.registration_m / width_m
    limit = np.maximum(limit, _LEAST_SPACINGS * scale.spacing_m / width_m)
    limit = np.maximum(limit, _LEAST_SCATTER * rough)
    moved = np.abs(measured.distance) > limit  # False where it is not known
    moved |= (measured.lost >= _LEAST_VOXELS) | (measured.gained >= _LEAST_VOXELS)
    known = measured.distance[~np.isnan(measured.distance)]
    shift_m = float(np.median(known)) * width_m if len(known) else 0.0
    # (2) Ground of another colour.
    gains = np.ones(3)
    painted = np.zeros(len(keys), dtype=bool)
    if has_colour:
        gains, painted = _colour_changes(blocks, before, after, ~moved, threads)
    # (3) Not by chance alone: with others that touch. Then what touches these.
    sure = _clustered(keys, moved | painted)
    renewed = sure.copy()
    for step in _STEPS:
        at = np.searchsorted(keys, keys[sure] + step)
        at[at == len(keys)] = 0
        renewed[at[keys[at] == keys[sure] + step]] = True
    return GroundChange(moved & sure, painted & sure, renewed, gains, shift_m)


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
    blocks: Int64, before: GroundSums, after: GroundSums, still: Bool, threads: int
) -> tuple[Float64, Bool]:
    """Gains between the surveys, and cubes whose colour differs beyond them."""
    both = (before.sums[:, COUNT] >= LEAST) & (after.sums[:, COUNT] >= LEAST)
    rows = np.flatnonzero(both & still)
    painted = np.zeros(len(both), dtype=bool)
    if not len(rows):
        return np.ones(3), painted
    # (1) One gain per channel. Of logarithms, so that exchanged surveys give its inverse.
    logarithms = []
    for channel in range(3):
        old = _mean(before, channel, rows)
        new = _mean(after, channel, rows)
        dark, bright = _GAIN_LEVELS
        clear = (np.minimum(old, new) >= dark) & (np.maximum(old, new) <= bright)
        ratio = np.log(new[clear] / old[clear])
        logarithms.append(float(np.median(ratio)) if len(ratio) else 0.0)
    gains = np.exp(logarithms)
    # (2) What is left, cube by cube: half of the gain is taken from either survey.
    rows = np.flatnonzero(both)
    steps = np.empty((len(rows), 3), np.float32)
    variance = np.empty(len(rows), np.float32)

    def work(begin: int, end: int) -> None:
        some = rows[begin:end]
        for channel, gain in enumerate(np.sqrt(gains)):
            old, new = _mean(before, channel, some), _mean(after, channel, some)
            steps[begin:end, channel] = new / gain - old * gain
        variance[begin:end] = _variance(before, some) + _variance(after, some)

    in_chunks(work, len(rows), threads=threads)
    levels = np.abs(steps).max(axis=1)
    painted[rows] = levels > _LEAST_LEVELS + _SURE * np.sqrt(variance)
    # (3) And block by block, whose mean shows what single cubes leave in doubt.
    block = blocks[rows]
    count = np.maximum(np.bincount(block), 1)
    error = np.sqrt(np.bincount(block, variance)) / count
    strongest = np.max([np.abs(np.bincount(block, step)) / count for step in steps.T], axis=0)
    painted[rows] |= (strongest > _LEAST_LEVELS + _SURE * error)[block]
    return gains, painted


def _mean(ground: GroundSums, channel: int, rows: Int64) -> Float32:
    mean: Float32 = (
        ground.sums[rows, COLOUR + channel] / ground.sums[rows, COUNT].astype(np.float64)
    ).astype(np.float32)
    return mean


def _variance(ground: GroundSums, rows: Int64) -> Float64:
    """Of a channel's mean: a third of all channels' scatter, over the samples."""
    sums = ground.sums[rows].astype(np.float64)
    count = sums[:, COUNT]
    squares = 16.0 * sums[:, SQUARE] - (sums[:, COLOUR:SQUARE] ** 2).sum(axis=1) / count
    variance: Float64 = np.maximum(squares, 0.0) / (3.0 * count * (count - 1.0))
    return variance
