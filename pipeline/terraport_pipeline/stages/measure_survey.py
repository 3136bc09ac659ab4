"""What the whole survey is like, measured on windows of it: spacing, and what is usual.

A tile must not judge by itself what an outlier is or how dense samples lie, or two tiles would
judge the same samples differently. So 64 windows are taken round samples of the thinned survey
(which are spread evenly over the samples), each read in full density, and the medians over them
stand for the medians over all. Memory: one block of the survey and the windows, about 200 MB.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Float64
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.geometry.clouds.outliers import mean_distances, usual_distance
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
        No arrays; ``spacing_m``, ``usual_log_m``, ``usual_deviation``, ``extent_m``, ``low`` and
        ``high`` (of the thinned cloud, scene frame) and ``points``.
    """
    reader = NpyReader(points_file)
    share = len(thinned.points) / len(reader)
    # Thinned by a factor, samples stand the root of it farther apart.
    guess_m = thinned.spacing_m * min(1.0, share) ** 0.5
    step = max(1, len(thinned.points) // _WINDOWS)
    centres = to_crs(thinned.points[::step][:_WINDOWS], thinned.origin)
    context.progress.start("measure: windows", float(len(reader)), "points")
    around = _collect(reader, centres, _OUTER_SPACINGS * guess_m, context)
    local, means = [], []
    for centre, points in zip(centres, around, strict=True):
        if len(points) <= neighbours:
            continue
        nearest = nearest_neighbours(points - centre, neighbours, workers=context.threads)
        inner = np.flatnonzero((np.abs(points - centre) <= _INNER_SPACINGS * guess_m).all(axis=1))
        inner = inner[:: max(1, -(-len(inner) // _PER_WINDOW))]
        local.append(areal_from_radius(nearest.distances[inner, -1], neighbours))
        means.append(mean_distances(nearest)[inner])
    spacing_m = float(np.median(np.concatenate(local))) if local else thinned.spacing_m
    mean_m: Float32 = np.concatenate(means) if means else np.array([spacing_m], np.float32)
    usual = usual_distance(mean_m)
    low, high = thinned.points.min(axis=0), thinned.points.max(axis=0)
    context.progress.done({"spacing_m": spacing_m})
    values = {
        "spacing_m": spacing_m,
        "usual_log_m": usual[0],
        "usual_deviation": usual[1],
        "extent_m": float((high - low).max()),
        "low": [float(v) for v in low],
        "high": [float(v) for v in high],
        "points": len(reader),
    }
    return Stored({}, values)


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
