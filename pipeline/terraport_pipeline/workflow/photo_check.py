"""Whether photos show the survey: those that agree with nothing are left out, with a word.

A photo of another place, or turned by half, would be drawn onto the ground as if it were true. So
before anything is made of them, every photo is compared at the cloud's points with two witnesses:
the cloud's colours, and what the other photos show of the same points. One that agrees with neither
is left out. A cloud whose colours are no light (classes, heights) is outvoted by photos that agree
with each other. Photos that would agree much better if they were moved are kept, and told of.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from terraport_payload.types import AnyFloat, Float32, Float64, Int32, UInt8
from terraport_pipeline.engines.photo_store import SCALES
from terraport_pipeline.engines.photos import OpenPhotos, named
from terraport_pipeline.errors import PhotoError
from terraport_pipeline.geometry.photos.photo_agreement import correlation, moved_correlations
from terraport_pipeline.geometry.photos.photo_samples import SRGB_OFFSET

__all__ = ["Agreement", "agreements", "checked_photos"]

_PICTURE_PX: Final = 640
"""Longest side at which photos are compared: a pixel is some 30 cm, a point's neighbourhood."""

_REACH_SHARE: Final = 0.06
"""Part of the picture's longest side by which photos are moved at most: some ten metres."""

_LEAST_POINTS: Final = 200
"""Points in a photo for a comparison that means something."""

_MOST_POINTS: Final = 3000
"""Points a photo that are looked at."""

_LEAST_CONTRAST: Final = 3.0
"""Standard deviation, levels, below which a witness has nothing to agree about."""

_DISAGREES: Final = 0.4
"""Correlation below which a witness speaks against a photo. Right ones have 0.78 and more (75 of
earthworks, 18 of a beach with trees); turned ones or those of another place up to 0.5, one in
twenty above 0.4."""

_DISAGREES_STRICTLY: Final = 0.65
"""The same where most photos are wrong: then the rest may be right by chance."""

_RIGHT_BESIDE: Final = 0.7
"""Correlation from which a photo counts as right but moved; the best of so many places is 0.6 for
photos that are wrong."""

_BRIGHTER: Final = 2.3
"""Factor in light between photos and cloud from which the photos do not follow the cloud; as in
:mod:`terraport_pipeline.geometry.photos.photo_gains`."""

_BETTER: Final = 0.1
"""Gain of the correlation from which a photo counts as moved."""

_LEAST_MOVE_PX: Final = 3.0
"""Of the picture that is compared: less is the cameras' usual error."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """What one photo has to do with the survey."""

    points: int
    """Points that were compared."""
    cloud: float | None
    """Correlation with the cloud's colours; None where it has none, or too few or too even."""
    others: float | None
    """Correlation with the other photos; None as there."""
    moved: float
    """Correlation with the cloud at the best place near by; 0 without a cloud."""
    move_m: float
    """How far away that is, metres on the ground."""
    brighter: float
    """Light of the photo over that of the cloud; 1 without a cloud."""

    def disagrees(self, limit: float = _DISAGREES) -> bool:
        """Whether every witness speaks against it, and there is one."""
        correlations = [one for one in (self.cloud, self.others) if one is not None]
        return bool(correlations) and max(correlations) < limit and not self.moved >= _RIGHT_BESIDE

    @property
    def is_moved(self) -> bool:
        """Whether it would agree much better elsewhere."""
        return self.cloud is not None and self.moved > max(_RIGHT_BESIDE, self.cloud + _BETTER)


@dataclass(frozen=True, slots=True, eq=False)
class _Sampled:
    """Brightness of a photo around the points that it sees, and where they lie in it."""

    picture: Float32
    rows: npt.NDArray[np.intp]
    """Points inside, away from the rim."""
    column: Int32
    row: Int32
    pixel_m: float
    reach: int

    @property
    def levels(self) -> Float32:
        """Brightness at every point that the photo sees, (P,)."""
        levels: Float32 = self.picture[self.row, self.column]
        return levels


def checked_photos(opened: OpenPhotos, points: Float32, colours: UInt8 | None) -> OpenPhotos:
    """Leave out photos that cannot be decoded, and those that show something else.

    Parameters
    ----------
    opened : OpenPhotos
    points : ndarray of shape (N, 3), float32
        Some of the cloud, evenly over it, scene frame; 20,000 are enough.
    colours : ndarray of shape (N, 3), uint8, or None
        Theirs; None where the cloud has none.

    Returns
    -------
    OpenPhotos
        With more warnings. May be empty: then nothing is known of the surface but the cloud.
    """
    # (1) Which photos disagree with the others and the cloud. Where most do, the measure itself
    # is in doubt (a cloud of other colours): only the plainest cases count.
    damaged: dict[int, PhotoError] = {}
    agreement_of = agreements(opened, points, colours, damaged)
    names = [view.name for view in opened.views]
    wrong = [number for number, one in agreement_of.items() if one.disagrees()]
    if 2 * len(wrong) > len(agreement_of):
        wrong = [
            number for number, one in agreement_of.items() if one.disagrees(_DISAGREES_STRICTLY)
        ]
    # (2) What is left out, in words.
    texts = []
    if damaged:
        texts.append(
            f"{len(damaged):,} of {len(names):,} photos cannot be used and are left out: "
            f"{next(iter(damaged.values()))}"
        )
    if wrong:
        texts.append(
            f"{len(wrong):,} of {len(names):,} photos show neither what the cloud nor what the "
            f"other photos show of the same places ({named([names[n] for n in wrong])}); they are "
            "left out: are they of this survey, under their own names, and not turned?"
        )
    kept = [n for n in range(len(names)) if n not in damaged and n not in wrong]
    # (3) What the photos that stay have in common, which is no reason to leave any out.
    moved = [agreement_of[n] for n in kept if n in agreement_of and agreement_of[n].is_moved]
    if 2 * len(moved) > len(kept) > 0:
        texts.append(
            f"{len(moved):,} of {len(kept):,} photos lie about "
            f"{np.median([one.move_m for one in moved]):.1f} m beside the cloud, so textures are "
            "smeared: look at the cameras' coordinates (--camera-offset) and at the survey's "
            "coordinate reference system"
        )
    brighter = float(
        np.median([agreement_of[n].brighter for n in kept if n in agreement_of] or [1.0])
    )
    if not 1.0 / _BRIGHTER <= brighter <= _BRIGHTER:
        texts.append(
            f"the photos have {brighter:.2g} times the light of the cloud's colours, and textures "
            "follow the photos: are they over- or under-exposed?"
        )
    if 2 * len(moved) <= len(kept) and _median_of(agreement_of, kept) < _DISAGREES:
        texts.append(
            "the photos agree with each other and not with the cloud's colours: what no photo "
            "shows will look different"
        )
    if not kept:
        texts.append("no photo is left, so the whole surface has the cloud's colours")
    return opened.only(kept, texts)


def _median_of(agreement_of: dict[int, Agreement], kept: list[int]) -> float:
    correlations = [
        one.cloud for n, one in agreement_of.items() if n in kept and one.cloud is not None
    ]
    return float(np.median(correlations)) if correlations else 1.0


def agreements(
    opened: OpenPhotos, points: Float32, colours: UInt8 | None, damaged: dict[int, PhotoError]
) -> dict[int, Agreement]:
    """Compare every photo with its witnesses.

    Parameters
    ----------
    opened, points, colours
        As for :func:`checked_photos`.
    damaged : dict
        Gets the photos that cannot be decoded, by number.

    Returns
    -------
    dict of int to Agreement
        By number; photos with too few points are not in it.
    """
    positions = points.astype(np.float64)
    light = None if colours is None else colours.astype(np.float32).mean(axis=1)
    if light is not None and float(light.std()) == 0.0:
        light = None
    # (1) Sample every photo at the points that it sees. Invariant: total and count are the sums
    # of all readable photos' standardised levels by point.
    sampled: dict[int, _Sampled] = {}
    total, count = np.zeros(len(positions)), np.zeros(len(positions), np.int64)
    for number in range(len(opened.views)):
        try:
            one = _sample(opened, number, positions)
        except PhotoError as error:
            damaged[number] = error
            continue
        if one is not None:
            sampled[number] = one
            total[one.rows] += _standard(one.levels)
            count[one.rows] += 1
    agreement_of = {}
    for number, one in sampled.items():
        # (2) The other photos as a witness: their mean without this photo's own.
        shared = count[one.rows] > 1
        own = _standard(one.levels)
        mean = (total[one.rows] - own) / np.maximum(count[one.rows] - 1, 1)
        # (3) The cloud as a witness, and whether it agrees better some pixels away.
        cloud = None if light is None else _witness(one.levels, light[one.rows])
        moved, move_m = 0.0, 0.0
        if light is not None and cloud is not None:
            near = moved_correlations(one.picture, one.column, one.row, light[one.rows], one.reach)
            dy, dx = np.unravel_index(int(near.argmax()), near.shape)
            away = float(np.hypot(dx - one.reach, dy - one.reach))
            if away >= _LEAST_MOVE_PX:
                moved, move_m = float(near.max()), away * one.pixel_m
        agreement_of[number] = Agreement(
            len(one.rows),
            cloud,
            _witness(own[shared], mean[shared], least=0.0),
            moved,
            move_m,
            1.0 if light is None else _light(one.levels) / _light(light[one.rows]),
        )
    return agreement_of


def _sample(opened: OpenPhotos, number: int, positions: Float64) -> _Sampled | None:
    """Look at the points in a photo; None where they are too few."""
    view = opened.views[number]
    lens = view.lens
    longest = max(lens.width, lens.height)
    scale = next((one for one in SCALES if longest / one <= _PICTURE_PX), SCALES[-1])
    picture = opened.photos.get(number, scale).astype(np.float32).mean(axis=2)
    pixels, depth = view.project(positions)
    size = np.array([picture.shape[1] / lens.width, picture.shape[0] / lens.height])
    at = pixels * size
    reach = max(1, round(_REACH_SHARE * max(picture.shape)))
    with np.errstate(invalid="ignore"):
        inside = ((at >= reach) & (at < [picture.shape[1] - reach, picture.shape[0] - reach])).all(
            axis=1
        )
    rows = np.flatnonzero(inside)
    rows = rows[:: max(1, -(-len(rows) // _MOST_POINTS))]
    if len(rows) < _LEAST_POINTS:
        return None
    column, row = at[rows].astype(np.int32).T
    pixel_m = float(np.median(depth[rows])) / (lens.fx * size[0])
    return _Sampled(picture, rows, column.copy(), row.copy(), pixel_m, reach)


def _light(levels: Float32) -> float:
    """Light of the median of sRGB levels; a factor in light is one here, too."""
    return float((np.median(levels) + SRGB_OFFSET) ** 2.4)


def _standard(levels: Float32) -> Float64:
    """Levels without the photo's exposure and contrast."""
    centred = levels.astype(np.float64) - levels.mean(dtype=np.float64)
    standard: Float64 = centred / max(float(centred.std()), 1e-6)
    return standard


def _witness(
    levels: AnyFloat,
    reference: AnyFloat,
    least: float = _LEAST_CONTRAST,
) -> float | None:
    if len(reference) < _LEAST_POINTS or not float(reference.std()) > least:
        return None
    return correlation(levels, reference)
