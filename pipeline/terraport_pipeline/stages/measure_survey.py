"""What the whole survey is like, measured on windows of it: spacing, noise, what is usual.

A tile must not judge by itself what an outlier is or how dense samples lie, or two tiles would
judge the same samples differently. So 64 windows are taken round samples of the thinned survey
(which are spread evenly over the samples), each read in full density, and the medians over them
stand for the medians over all. Memory: one block of the survey and the windows, about 200 MB.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Float64, Int64
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.geometry.clouds.noise import window_noise
from terraport_pipeline.geometry.clouds.outliers import (
    duplicate_mask,
    mean_distances,
    usual_distance,
)
from terraport_pipeline.geometry.clouds.spacing import areal_from_radius, nearest_neighbours
from terraport_pipeline.model import Cloud, to_crs
from terraport_pipeline.stages.contract import Context, Stored

__all__ = ["NAME", "run"]

NAME: Final = "measure_survey"

_WINDOWS: Final = 64

_INNER_SPACINGS: Final = 16.0
"""Half a window's width within which samples are measured: about a thousand."""

_OUTER_SPACINGS: Final = 26.0
"""Half its width within which they have their neighbours."""

_PER_WINDOW: Final = 1000
"""Samples measured per window at most, so that dense places do not count more."""

_NOISE_PER_WINDOW: Final = 100
"""Of these the noise is measured: 64 windows tell its median within 3 %, in four seconds."""

_THIN_SPACINGS: Final = 3.0
"""A sample stands for the area of so many spacings' side at most, as everywhere: the lone ones
beside a survey have no surface of their own."""

_BLOCK_ROWS: Final = 1_000_000


def run(points_file: Path, thinned: Cloud, neighbours: int, context: Context) -> Stored:
    """Measure.

    Parameters
    ----------
    points_file : pathlib.Path
        ``points.npy`` of the read stage: (N, 3) float64, CRS frame.
    thinned : Cloud
        Some of the same samples, evenly, cleaned.
    neighbours : int
        Per sample, as the clean stage takes.
    context : Context

    Returns
    -------
    Stored
        No arrays; ``spacing_m`` (median), ``surface_spacing_m`` (root of the mean area that a
        sample stands for, along the surface), ``noise_m``, ``usual_log_m``, ``usual_deviation``,
        ``extent_m``, ``low`` and ``high`` (of the thinned cloud, scene frame) and ``points``.
    """
    reader = NpyReader(points_file)
    share = len(thinned.points) / len(reader)
    # Thinned by a factor, samples stand the root of it farther apart.
    guess_m = thinned.spacing_m * min(1.0, share) ** 0.5
    step = max(1, len(thinned.points) // _WINDOWS)
    centres = to_crs(thinned.points[::step][:_WINDOWS], thinned.origin)
    context.progress.start("measure: windows", float(len(reader)), "points")
    around = _collect(reader, centres, _OUTER_SPACINGS * guess_m, context)
    local, means, noises_m, areas_m2 = [], [], [], []
    for centre, points in zip(centres, around, strict=True):
        if len(points) <= neighbours:
            continue
        nearest = nearest_neighbours(points - centre, neighbours, workers=context.threads)
        inner = np.flatnonzero((np.abs(points - centre) <= _INNER_SPACINGS * guess_m).all(axis=1))
        inner = inner[:: max(1, -(-len(inner) // _PER_WINDOW))]
        local.append(areal_from_radius(nearest.distances[inner, -1], neighbours))
        means.append(mean_distances(nearest)[inner])
        noise_m, area_m2 = _noise(points - centre, inner, context.threads)
        noises_m.append(noise_m)
        areas_m2.append(area_m2)
    spacing_m = float(np.median(np.concatenate(local))) if local else thinned.spacing_m
    mean_m: Float32 = np.concatenate(means) if means else np.array([spacing_m], np.float32)
    usual = usual_distance(mean_m)
    noise_m = float(np.median(noises_m)) if noises_m else 0.0
    surface_m = _surface_spacing(areas_m2) or spacing_m
    low, high = thinned.points.min(axis=0), thinned.points.max(axis=0)
    context.progress.done({"spacing_m": spacing_m, "noise_m": noise_m})
    values = {
        "spacing_m": spacing_m,
        "surface_spacing_m": surface_m,
        "noise_m": noise_m,
        "usual_log_m": usual[0],
        "usual_deviation": usual[1],
        "extent_m": float((high - low).max()),
        "low": [float(v) for v in low],
        "high": [float(v) for v in high],
        "points": len(reader),
    }
    return Stored({}, values)


def _noise(points: Float64, inner: Int64, workers: int) -> tuple[float, Float64]:
    """Noise of a window, and areas of some of its inner samples; copies have no distance."""
    first = ~duplicate_mask(points)
    rows = (np.cumsum(first) - 1)[inner[first[inner]]]
    rows = rows[:: max(1, -(-len(rows) // _NOISE_PER_WINDOW))]
    return window_noise(points[first], rows, workers=workers)


def _surface_spacing(areas_m2: list[Float64]) -> float:
    """Root of the mean area of all samples measured; 0 where there is none."""
    area_m2 = np.concatenate([np.zeros(0), *areas_m2])
    if not len(area_m2):
        return 0.0
    most_m2 = _THIN_SPACINGS**2 * float(np.median(area_m2))
    return float(np.sqrt(np.minimum(area_m2, most_m2).mean()))


def _collect(reader: NpyReader, centres: Float64, half_m: float, context: Context) -> list[Float64]:
    """Gather the samples of every window, in file order."""
    # A coarse grid sorts out nearly everything before windows are compared one by one.
    low = centres.min(axis=0) - 2 * half_m
    touched = set()
    for corner in np.ndindex(2, 2, 2):
        at = np.floor((centres + (np.array(corner) * 2 - 1) * half_m - low) / (2 * half_m))
        touched |= {tuple(key) for key in at.astype(np.int64).tolist()}
    size = np.array(sorted(touched)).max(axis=0) + 2
    keys = np.unique(np.ravel_multi_index(np.array(sorted(touched)).T, size))
    blocks_of_window: list[list[Float64]] = [[] for _ in centres]
    for _, block in reader.blocks(_BLOCK_ROWS):
        cell = np.floor((block - low) / (2 * half_m))
        inside = ((cell >= 0) & (cell < size)).all(axis=1)
        some = block[inside]
        cell_keys = np.ravel_multi_index(cell[inside].astype(np.int64).T, size)
        index = np.minimum(np.searchsorted(keys, cell_keys), len(keys) - 1)
        some = some[keys[index] == cell_keys]
        for window, centre in enumerate(centres):
            near = (np.abs(some - centre) <= half_m).all(axis=1)
            if near.any():
                blocks_of_window[window].append(some[near])
        context.progress.advance(len(block))
    return [np.concatenate([np.zeros((0, 3)), *blocks]) for blocks in blocks_of_window]
