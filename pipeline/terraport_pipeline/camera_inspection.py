"""``terraport inspect`` for cameras: what they are, where they look, how well they fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from terraport_payload.types import Float64, UInt8
from terraport_pipeline.engines.camera_files import read_cameras, read_raw_cameras
from terraport_pipeline.engines.photos import OpenPhotos, open_photos, sizes_below
from terraport_pipeline.errors import PhotoError
from terraport_pipeline.geometry.photos.lens import Lens, valid_radius
from terraport_pipeline.geometry.photos.view_cover import cover_points
from terraport_pipeline.model import to_scene
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.sample.chosen_files import choose_files
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.survey.survey_files import SurveyFiles
from terraport_pipeline.workflow.build_forecast import BuildForecast, PhotoSet, with_photos

__all__ = ["forecast_with_photos", "inspect_cameras", "inspect_photos"]

MAX_POINTS: Final = 200_000
"""Points of the survey that are projected."""

MAX_COMPARED: Final = 8
"""Photos whose colours are compared with the cloud's."""

_PHOTO_BYTES: Final = 1 << 30
"""Bound of decoded photos; one at a time is used."""

_LEAST_POINTS: Final = 200
"""Points in a photo for a comparison that means something."""


def inspect_cameras(path: Path, photos: Path | None = None) -> dict[str, Any]:
    """Describe cameras in their file's own coordinates.

    Parameters
    ----------
    path : Path
        Any file or folder that :func:`read_cameras` takes.
    photos : Path, optional
        Folder of the photos, where the file does not say their size.

    Returns
    -------
    dict
        Plain values, ready for JSON: ``format``, ``count``, ``lenses``, ``frames`` (how the
        coordinates may be meant), ``centres`` (least and greatest), ``warnings``.

    Raises
    ------
    ReadError, PhotoError
    """
    raw = read_raw_cameras(path, sizes_below(photos))
    centres = np.stack([camera.centre for camera in raw.cameras])
    return {
        "format": raw.format,
        "count": len(raw.cameras),
        "lenses": _lenses([camera.lens for camera in raw.cameras]),
        "frames": [str(frame) for frame in raw.frames],
        "centres": {"min": centres.min(axis=0).tolist(), "max": centres.max(axis=0).tolist()},
        "warnings": list(raw.warnings),
    }


def inspect_photos(
    files: SurveyFiles | Path,
    cameras: Path,
    *,
    photos: Path | None = None,
    offset: tuple[float, float, float] | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Describe cameras together with the survey whose photos they took.

    Parameters
    ----------
    files : SurveyFiles or Path
        The survey; of a large one pieces that are spread over it are read.
    cameras : Path
    photos : Path, optional
        Folder of the photos; with it sizes are checked and colours are compared.
    offset : tuple of float, optional
        Added to the cameras' coordinates.
    progress : Progress, optional
        Told of the reading of the survey.

    Returns
    -------
    dict
        As :func:`inspect_cameras` with ``frame`` in place of ``frames`` and ``centres``, and
        ``coverage`` (share of the cloud in any photo, photos per point), ``pixel_m`` (ground
        sampling distance), ``height_above_m`` (cameras over the cloud's median), ``idle`` (photos
        that show nothing of the cloud) and ``colours`` (correlation of the photos' brightness with
        the cloud's; None without photos or colours).

    Raises
    ------
    ReadError, PhotoError
        Also when the cameras do not look at the cloud.
    """
    # (1) The survey's samples, in the scene's frame.
    chosen, share = choose_files(*SurveyFiles.of(files).heads(NullProgress()))
    survey = read_survey(chosen, max_points=MAX_POINTS, progress=progress, share=share)
    origin = np.floor(survey.points.min(axis=0))
    points = to_scene(survey.points, origin).astype(np.float64)
    placed = read_cameras(
        cameras,
        origin=origin,
        crs=survey.crs,
        offset=offset,
        samples=points,
        photo_size=sizes_below(photos),
    )
    views, warnings = placed.views, list(placed.warnings)
    # (2) With the photos: their sizes, and whether their colours are the cloud's.
    colours = None
    if photos is not None:
        opened = open_photos(views, photos, max_bytes=_PHOTO_BYTES)
        views = opened.views
        warnings += opened.warnings
        if survey.colours is not None:
            colours = _compare(opened, points, survey.colours)
    # (3) How the cloud is covered.
    photos_per_point, finest_m, points_in_view = cover_points(views, points)
    seen = photos_per_point > 0
    if not seen.any():
        raise PhotoError("no photo that is there shows any of the cloud; look at the warnings")
    heights_m = np.array([view.position[1] for view in views]) - np.median(points[:, 1])
    idle = [view.name for view, n in zip(views, points_in_view, strict=True) if n == 0]
    return {
        "format": placed.format,
        "count": len(views),
        "lenses": _lenses([view.lens for view in views]),
        "frame": placed.frame,
        "coverage": {
            "share": round(float(seen.mean()), 4),
            "photos_per_point": _spread(photos_per_point[seen]),
        },
        "pixel_m": _spread(finest_m[seen]),
        "height_above_m": _spread(heights_m),
        "idle": idle,
        "colours": colours,
        "warnings": warnings,
    }


def forecast_with_photos(survey: Mapping[str, Any], photos: Mapping[str, Any]) -> dict[str, Any]:
    """Forecast a build of a survey with its photos.

    Parameters
    ----------
    survey : mapping
        Of :func:`~terraport_pipeline.survey_inspection.inspect_points`, with a forecast.
    photos : mapping
        Of :func:`inspect_photos`, with the photos.

    Returns
    -------
    dict
        As the survey's ``forecast``.
    """
    plain = dict(survey["forecast"])
    beside = {name: plain.pop(name) for name in ("cores", "max_memory_bytes")}
    pixels = sum(lens["photos"] * lens["size"][0] * lens["size"][1] for lens in photos["lenses"])
    photo_set = PhotoSet(pixels / 1e6, photos["pixel_m"]["median"], survey["ground"]["surface_m2"])
    textured = with_photos(BuildForecast(**plain), photo_set, threads=beside["cores"])
    return {**asdict(textured), **beside}


def _lenses(lenses: Sequence[Lens]) -> list[dict[str, Any]]:
    rows = []
    for lens in dict.fromkeys(lenses):
        corners = np.array([(x, y) for x in (0, lens.width) for y in (0, lens.height)], float)
        rays = lens.unproject(corners)
        widest = np.degrees(np.arccos(np.clip(rays[:, 2], -1.0, 1.0)))
        limit = valid_radius(lens)
        rows.append(
            {
                "photos": sum(one == lens for one in lenses),
                "size": [lens.width, lens.height],
                "focal_px": [round(lens.fx, 3), round(lens.fy, 3)],
                "principal_px": [round(lens.cx, 3), round(lens.cy, 3)],
                "model": lens.model,
                "distorted": any((*lens.radial, *lens.tangential, *lens.denominator)),
                "corner_deg": None if np.isnan(widest).any() else round(float(widest.max()), 2),
                "valid_deg": round(
                    float(np.degrees(limit if lens.model == "fisheye" else np.arctan(limit))), 2
                ),
            }
        )
    return rows


def _spread(values: npt.NDArray[np.generic]) -> dict[str, float]:
    low, middle, high = np.percentile(values.astype(np.float64), (5, 50, 95))
    return {"p5": round(low, 5), "median": round(middle, 5), "p95": round(high, 5)}


def _compare(opened: OpenPhotos, points: Float64, colours: UInt8) -> dict[str, Any] | None:
    """Correlate brightness of photos and cloud: cameras that are off by a little lose it first."""
    correlations = {}
    step = max(1, len(opened.views) // MAX_COMPARED)
    for index in range(0, len(opened.views), step):
        view = opened.views[index]
        pixels, _ = view.project(points)
        size = (view.lens.width, view.lens.height)
        inside = ((pixels >= 0) & (pixels < size)).all(axis=1)
        if inside.sum() < _LEAST_POINTS:
            continue
        photo = opened.photos.get(index).astype(np.float32).mean(axis=2)
        column, row = pixels[inside].astype(np.int64).T
        ours = photo[row, column]
        theirs = colours[inside].astype(np.float32).mean(axis=1)
        if ours.std() > 0.0 and theirs.std() > 0.0:
            correlations[view.name] = round(float(np.corrcoef(ours, theirs)[0, 1]), 3)
    if not correlations:
        return None
    return {
        "median": round(float(np.median(list(correlations.values()))), 3),
        "photos": correlations,
    }
