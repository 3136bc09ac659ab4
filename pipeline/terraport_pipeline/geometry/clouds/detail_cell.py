"""How fine a surface to solve, and how far to smooth its samples first: from spacing and noise.

Two lengths say what a cloud holds. Below its *spacing* there is nothing to see; below its *noise*
what is seen is not the surface. The ratio of the two, noise over spacing, decides here: 0.05 to 0.1
for a good survey, 2 for a cheap dense one. Figures: docs/benchmarks.md.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from typing import Final

__all__ = ["choose_cell", "detail_cell_m", "noise_ratio", "smoothing_radius_m"]

CELL_SPACINGS: Final = 1.2
"""Cell of a clean cloud, in spacings. Marching a surface through cells makes 2.3 to 3.7 faces per
square of a cell's side (a beach; a forest), so 1.6 to 2.4 faces per sample."""

_CLEAN_RATIO: Final = 0.3
"""Noise below this much of the spacing is averaged away by the solver itself."""

_MOST_RATIO: Final = 6.0
"""Noise beyond so many spacings counts as this: a tile's margin bounds how far samples may act."""

_CELL_GROWTH: Final = 0.35
"""Growth of the cell per spacing of noise: 1.5 spacings at a noise of 1, 1.9 at 2, 2.3 at 3."""

_RADIUS: Final = 5.5
"""Smoothing radius at a noise of one spacing, in spacings. Least error of a local fit lies at a
radius that grows with the cube root of the noise (variance falls with its square, the bias of a
curved surface grows with it)..."""

_LEAST_DEVIATIONS: Final = 2.75
"""...but a neighbourhood narrower than so many deviations of the noise shows no surface."""


def noise_ratio(spacing_m: float, noise_m: float) -> float:
    """Noise in spacings, between 0 and what can be followed."""
    return min(noise_m / spacing_m, _MOST_RATIO)


def detail_cell_m(spacing_m: float, noise_m: float) -> float:
    """Side of the detail's cells; follows density and noise without steps.

    Parameters
    ----------
    spacing_m : float
        Root of the area that a sample stands for, along the surface.
    noise_m : float
        Standard deviation of the samples across the surface.

    Returns
    -------
    float
        Metres.

    Examples
    --------
    >>> round(detail_cell_m(0.2, 0.01), 3), round(detail_cell_m(0.2, 0.4), 3)
    (0.24, 0.383)
    """
    beyond = max(noise_ratio(spacing_m, noise_m) - _CLEAN_RATIO, 0.0)
    return CELL_SPACINGS * spacing_m * (1.0 + _CELL_GROWTH * beyond)


def choose_cell(
    asked_depth: int | None, side_m: float, spacing_m: float, noise_m: float
) -> tuple[float, list[str]]:
    """Take the cells of an octree depth that was asked for, where the cloud supports them.

    Parameters
    ----------
    asked_depth : int, optional
        Of an octree over the whole survey, as the thesis counts: cells of side / 2^depth.
    side_m : float
        Width of that octree: 1.1 times the longest side of the survey's box.
    spacing_m, noise_m : float
        As of :func:`detail_cell_m`, which answers where nothing was asked for.

    Returns
    -------
    cell_m : float
    choices : list of str
        One where finer cells were asked for than the survey supports.
    """
    cell_m = detail_cell_m(spacing_m, noise_m)
    if asked_depth is None:
        return cell_m, []
    asked_m = side_m / 2**asked_depth
    if asked_m >= cell_m:
        return asked_m, []
    choice = (
        f"cells of {cell_m:.3g} m instead of {asked_m:.3g} m (--detail-depth {asked_depth}): the "
        f"samples stand {spacing_m:.3g} m apart with a noise of {noise_m:.2g} m; finer cells would "
        "only add noise"
    )
    return cell_m, [choice]


def smoothing_radius_m(spacing_m: float, noise_m: float) -> float:
    """Radius of the fits that samples are moved onto before they are solved.

    Returns
    -------
    float
        Metres; 0 for clouds clean enough to be solved as they are.

    Examples
    --------
    >>> smoothing_radius_m(0.2, 0.01), round(smoothing_radius_m(0.2, 0.2), 3)
    (0.0, 1.1)
    """
    ratio = noise_ratio(spacing_m, noise_m)
    if ratio < _CLEAN_RATIO:
        return 0.0
    return spacing_m * max(_RADIUS * math.pow(ratio, 1 / 3), _LEAST_DEVIATIONS * ratio)
