"""Clean: from a survey as read to an oriented cloud in the scene frame.

Drops exact copies and outliers, measures the spacing, estimates normals and turns them out of the
ground. Memory: about 510 bytes per point beside the survey.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

import numpy as np
import numpy.typing as npt

from terraport_payload.types import Float32, Float64, Int64, UInt8
from terraport_pipeline.engines.readers.survey_colours import GREY
from terraport_pipeline.errors import SurveyError
from terraport_pipeline.geometry.clouds.normals import estimate_normals, orient_normals
from terraport_pipeline.geometry.clouds.outliers import duplicate_mask, outlier_mask
from terraport_pipeline.geometry.clouds.spacing import (
    Neighbours,
    estimate_spacing,
    nearest_neighbours,
    remaining_neighbours,
)
from terraport_pipeline.model import Cloud, Survey, to_scene
from terraport_pipeline.options.clean import MIN_POINTS, Options
from terraport_pipeline.stages.contract import Context, Facts, Form, Stored

__all__ = ["FORM", "NAME", "Cleaned", "Options", "run"]

NAME: Final = "clean"


_FLAT: Final = 1e-6
"""Thickness over extent below which a cloud counts as a plane or line: ten float32 steps."""

_CODE_VALUES: Final = 256
"""A whole-number attribute with at most this many values holds codes and is never averaged."""

_EXACT_INTEGER: Final = 1 << 24
"""Largest integer up to which float32 holds every integer."""

_WIDE_M: Final = 8192.0
"""Extent above which a float32 coordinate is coarser than half a millimetre."""


@dataclass(frozen=True, slots=True)
class Cleaned:
    """The cloud, and what later stages ask about it."""

    cloud: Cloud
    local_spacing_m: Float32
    """(N,) areal spacing around each point."""
    codes: tuple[str, ...]
    """Attributes that hold codes and must not be averaged."""
    facts: Facts


def run(
    survey: Survey, options: Options, context: Context, origin: Float64 | None = None
) -> Cleaned:
    """Clean and orient a survey.

    Parameters
    ----------
    survey : Survey
        N points, CRS frame.
    options : Options
    context : Context
    origin : ndarray of shape (3,), float64, optional
        Of the scene frame; chosen where it is not given.

    Returns
    -------
    Cleaned

    Raises
    ------
    SurveyError
        Too few different points, coordinates that are not finite, or all points on one line or
        plane.
    """
    warnings: list[str] = []
    points = survey.points
    _check_finite(points)
    count = len(points)
    # (1) exact copies
    context.progress.start("clean: copies", None, "points")
    stays = np.flatnonzero(~duplicate_mask(points))
    duplicates = count - len(stays)
    context.progress.done({"dropped": duplicates})
    _check_shape(points[stays], count)
    # (2) neighbours and outliers; float64 about the middle, because outliers may lie very far out
    middle = np.median(points[stays], axis=0)
    local = points[stays] - middle
    workers = context.threads
    context.progress.start("clean: neighbours", float(len(local)), "points")
    neighbours = nearest_neighbours(
        local, options.normal_neighbours, workers=workers, advance=context.progress.advance
    )
    removed = outlier_mask(
        neighbours, ratio=options.outlier_ratio, deviations=options.outlier_deviations
    )
    context.progress.done({"outliers": int(removed.sum())})
    outliers = int(removed.sum())
    if outliers:
        neighbours = remaining_neighbours(local, neighbours, removed, workers=workers)
        stays = stays[~removed]
        _check_shape(points[stays], count)
    if outliers > len(removed) // 20:
        warnings.append(
            f"{outliers} of {len(removed)} points were dropped as outliers; if that is too many, "
            "raise --outlier-ratio"
        )
    # (3) the scene frame
    if origin is None:
        origin = _choose_origin(points[stays])
    scene = to_scene(points[stays], origin)
    # (4) normals
    cloud, local_spacing_m, facts = _orient(scene, neighbours, options, context)
    if float(np.ptp(scene, axis=0).max()) > _WIDE_M:
        warnings.append(
            "the survey is wider than 8 km: coordinates far from its middle keep less than half a "
            "millimetre; split it"
        )
    attributes, codes, notes = _convert_attributes(survey.attributes, stays, survey.whole)
    warnings += notes
    return Cleaned(
        cloud=Cloud(
            points=scene,
            normals=cloud,
            colours=_colours(survey.colours, stays),
            attributes=attributes,
            origin=origin,
            spacing_m=facts["spacing_m"],
            has_colour=survey.colours is not None,
        ),
        local_spacing_m=local_spacing_m,
        codes=codes,
        facts=Facts(
            counts={
                "points_read": count,
                "duplicates": duplicates,
                "outliers": outliers,
                "points": len(stays),
                **facts,
            },
            warnings=tuple(warnings),
        ),
    )


def _store(result: Cleaned) -> Stored:
    cloud = result.cloud
    arrays: dict[str, npt.NDArray[np.generic]] = {
        "points": cloud.points,
        "normals": cloud.normals,
        "colours": cloud.colours,
        "local_spacing_m": result.local_spacing_m,
        "origin": cloud.origin,
    }
    arrays |= {f"attribute-{i}": values for i, values in enumerate(cloud.attributes.values())}
    values = {
        "attributes": list(cloud.attributes),
        "codes": list(result.codes),
        "spacing_m": cloud.spacing_m,
        "has_colour": cloud.has_colour,
    }
    return Stored(arrays, values)


def _restore(stored: Stored, facts: Facts) -> Cleaned:
    arrays, values = stored.arrays, stored.values
    return Cleaned(
        cloud=Cloud(
            points=np.asarray(arrays["points"], dtype=np.float32),
            normals=np.asarray(arrays["normals"], dtype=np.float32),
            colours=np.asarray(arrays["colours"], dtype=np.uint8),
            attributes={
                name: np.asarray(arrays[f"attribute-{i}"], dtype=np.float32)
                for i, name in enumerate(values["attributes"])
            },
            origin=np.asarray(arrays["origin"], dtype=np.float64),
            spacing_m=values["spacing_m"],
            has_colour=values["has_colour"],
        ),
        local_spacing_m=np.asarray(arrays["local_spacing_m"], dtype=np.float32),
        codes=tuple(values["codes"]),
        facts=facts,
    )


FORM: Final = Form(_store, _restore, attrgetter("facts"))


def _check_finite(points: Float64) -> None:
    good = np.isfinite(points).all(axis=1)
    if not good.all():
        first = int(np.flatnonzero(~good)[0])
        raise SurveyError(
            f"{int((~good).sum())} of {len(points)} points have coordinates that are not numbers, "
            f"the first is point {first}; remove them"
        )


def _check_shape(points: Float64, read: int) -> None:
    """Refuse clouds with too few points, or none that span a surface."""
    if len(points) < MIN_POINTS:
        raise SurveyError(
            f"{len(points)} different points (of {read} read); a surface needs at least "
            f"{MIN_POINTS}"
        )
    local = points - points.mean(axis=0)
    extent_m = float(np.abs(local).max())
    thickness = np.sqrt(np.maximum(np.linalg.eigvalsh(local.T @ local / len(local)), 0.0))
    kind = "line" if thickness[1] <= _FLAT * extent_m else "plane"
    if thickness[0] <= _FLAT * extent_m:
        raise SurveyError(
            f"all {len(points)} points lie on one {kind} (thickness {thickness[0]:.2g} m over "
            f"{2 * extent_m:.4g} m); expected a surface with relief: are heights missing?"
        )


def _choose_origin(points: Float64) -> Float64:
    """Middle of the box in whole metres, at the floor of the lowest height."""
    low, high = points.min(axis=0), points.max(axis=0)
    east, north = np.rint((low + high) / 2)[:2]
    return np.array([east, north, np.floor(low[2])])


def _orient(
    scene: Float32, neighbours: Neighbours, options: Options, context: Context
) -> tuple[Float32, Float32, dict[str, float]]:
    """Estimate the spacing, and normals that consistently point out of the ground."""
    context.progress.start("clean: normals", None, "points")
    spacing = estimate_spacing(neighbours)
    normals, curvature = estimate_normals(
        scene, neighbours, k=options.normal_neighbours, threads=context.threads
    )
    normals, spread, guessed = orient_normals(scene, normals, neighbours, spacing_m=spacing.areal_m)
    facts = {
        "spacing_m": spacing.areal_m,
        "nearest_neighbour_m": spacing.median_m,
        "noise_m": _noise_m(neighbours, curvature),
        "extent_m": float(np.ptp(scene, axis=0).max()),
        "normals_spread": spread,
        "normals_guessed": guessed,
        "facing_down": int((normals[:, 1] < 0).sum()),
    }
    context.progress.done({"spread": spread, "guessed": guessed})
    return normals, spacing.local_m, facts


def _noise_m(neighbours: Neighbours, curvature: Float32) -> float:
    """Median thickness of the neighbourhoods: noise, plus what the surface curves within them.

    For k samples of a disk of radius r the variance along the disk is r^2/4 on either axis, so the
    thickness is ``r * sqrt(c / (2 (1 - c)))`` with c the smallest eigenvalue's share.
    """
    radius_m = neighbours.distances[:, -1]
    share = np.clip(curvature, 0.0, 1.0 / 3.0)
    return float(np.median(radius_m * np.sqrt(share / (2.0 * (1.0 - share)))))


def _convert_attributes(
    attributes: Mapping[str, npt.NDArray[np.generic]], stays: Int64, whole: Collection[str] = ()
) -> tuple[dict[str, Float32], tuple[str, ...], list[str]]:
    """Convert attributes to float32; find those that hold codes; tell of what loses precision."""
    out: dict[str, Float32] = {}
    codes: list[str] = []
    notes: list[str] = []
    for name, column in attributes.items():
        values = np.asarray(column)[stays]
        if values.ndim != 1 or values.dtype.kind not in "biuf":
            notes.append(
                f"attribute {name!r} is not one number per point ({values.dtype}): left out"
            )
            continue
        converted = values.astype(np.float32)
        converted[~np.isfinite(converted)] = np.nan
        if values.dtype.kind in "biu" or name in whole:
            present = values[np.isfinite(values)] if name in whole else values
            if len(present) and int(np.abs(present.astype(np.int64)).max()) > _EXACT_INTEGER:
                notes.append(f"attribute {name!r} exceeds 2^24: its last digits are lost")
            if len(np.unique(present)) <= _CODE_VALUES:
                codes.append(name)
        elif _is_coarse(values, converted):
            notes.append(
                f"attribute {name!r} varies by less than 1e-7 of its size in places: its last "
                "digits are lost"
            )
        out[name] = converted
    return out, tuple(codes), notes


def _is_coarse(values: npt.NDArray[np.generic], converted: Float32) -> bool:
    """Whether float32 is coarser than the payload's 65535 steps over the range."""
    valid = np.asarray(values, dtype=np.float64)[np.isfinite(converted)]
    if not len(valid) or valid.min() == valid.max():
        return False
    step = float(np.spacing(np.float32(np.abs(valid).max())))
    return step > float(valid.max() - valid.min()) / 65535


def _colours(colours: UInt8 | None, stays: Int64) -> UInt8:
    if colours is None:
        return np.full((len(stays), 3), GREY, dtype=np.uint8)
    return colours[stays]
