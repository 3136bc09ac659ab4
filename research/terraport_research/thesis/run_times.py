"""Table 5.4: run time of TPA on meshes of the thesis's sizes, one thread and all."""

from __future__ import annotations

import os
import time
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Int32, UInt8
from terraport_pipeline.geometry.regions.triangle_pool import triangle_pools
from terraport_pipeline.progress import Progress
from terraport_research.booklet_model import Column, Row, Table
from terraport_research.options import ThesisOptions
from terraport_research.thesis.making import Made, Making

__all__ = ["coloured_ground", "make_run_times"]

KEY: Final = "run-times"
_THESIS_H: Final = {
    49_000: (0.05, 0.008),
    93_435: (0.12, 0.05),
    382_455: (27.0, 1.0),
    1_000_000: (72.0, 3.0),
    5_000_000: (120.0, 10.0),
    12_000_000: (192.0, 22.0),
}
"""Faces, and hours without and with multiprocessing (10 cores), as printed."""
_S_PER_H: Final = 3600.0
_EDGE_M: Final = 0.2
_NOISE: Final = 6.0
_WARM_FACES: Final = 2_000


def make_run_times(options: ThesisOptions, progress: Progress) -> Made:
    """Time TPA, arrays to labels, as it cuts regions of a build."""
    cores = os.cpu_count() or 1
    making = Making(
        KEY,
        "Run time of TPA: Table 5.4",
        f"Th .7, sTh .015, arrays to labels, {cores} cores",
        options.seed,
    )
    making.say(
        "Procedural ground with colours of noise 6, faces in file order, from vertices, faces and "
        "colours to labels, adjacency included. Wall seconds of a machine that others use too say "
        "less than CPU seconds. In brackets, and as hours in the note: what the thesis printed, "
        "without multiprocessing beside one thread, with ten cores beside all threads. Against "
        "hours any vectorised version looks fast: the difference says little of the algorithm."
    )
    sizes = [faces for faces in _THESIS_H if faces <= options.most_faces]
    columns = (
        Column("one_wall_s", "one thread", 2, "s"),
        Column("all_wall_s", "all threads", 2, "s"),
        Column("one_cpu_s", "one thread", 2, "CPU s"),
        Column("all_cpu_s", "all threads", 2, "CPU s"),
        Column("pools", "segments", 0),
    )
    # Kernels are compiled, or read from numba's cache, before anything is timed.
    small = coloured_ground(_WARM_FACES, options.seed)
    for threads in (1, cores):
        triangle_pools(small[0], small[1], colours=small[2], threads=threads)
    rows = []
    progress.start("TPA", float(len(sizes)), "meshes")
    for count in sizes:
        alone_h, ten_h = _THESIS_H[count]
        vertices, faces, colours = coloured_ground(count, options.seed)
        one = _timed(vertices, faces, colours, 1)
        every = _timed(vertices, faces, colours, cores)
        rows.append(
            Row(
                f"{count:,} faces",
                (one[0], every[0], one[1], every[1], float(one[2])),
                (alone_h * _S_PER_H, ten_h * _S_PER_H, None, None, None),
                f"{alone_h:g} h, with ten cores {ten_h:g} h",
            )
        )
        progress.advance(1)
    progress.done({"meshes": len(sizes)})
    making.tables.append(Table("5.4", "Table 5.4: run time of TPA", "size", columns, tuple(rows)))
    return making.made()


def _timed(
    vertices: Float32, faces: Int32, colours: UInt8, threads: int
) -> tuple[float, float, int]:
    """Wall seconds, processor seconds, pools."""
    wall, cpu = time.perf_counter(), time.process_time()
    pools = triangle_pools(vertices, faces, colours=colours, threads=threads)
    return time.perf_counter() - wall, time.process_time() - cpu, pools.count


def coloured_ground(n_faces: int, seed: int) -> tuple[Float32, Int32, UInt8]:
    """Make hills in patches of four noisy colours, with exactly so many faces.

    Returns
    -------
    vertices : ndarray of shape (V, 3), float32
        Metres, edges 0.2 long.
    faces : ndarray of shape (n_faces, 3), int32
    colours : ndarray of shape (V, 3), uint8
    """
    rng = np.random.default_rng([seed, n_faces])
    n = int(np.ceil(np.sqrt(n_faces / 2))) + 1
    side_m = (n - 1) * _EDGE_M
    axis = np.linspace(0.0, side_m, n, dtype=np.float32)
    x, z = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    y, field = np.zeros_like(x), np.zeros_like(x)
    for octave in range(5):
        wave = np.float32(2.0**octave * 2.0 * np.pi / side_m)
        a, b, c, d = rng.uniform(0.0, 2.0 * np.pi, 4).astype(np.float32)
        y += np.float32(side_m / 20.0 / 2.0**octave) * np.sin(wave * x + a) * np.cos(wave * z + b)
        stripes = np.sin(np.float32(0.7) * wave * x + c + np.float32(0.3) * wave * z)
        field += stripes * np.cos(wave * z + d) / np.float32(1.5**octave)
    palette = np.array([[60, 80, 50], [140, 120, 95], [190, 175, 150], [90, 90, 95]], np.float32)
    colours = palette[np.digitize(field, [-0.6, 0.3, 0.9])]
    colours += rng.normal(0.0, _NOISE, colours.shape).astype(np.float32)
    i, j = np.divmod(np.arange((n - 1) ** 2, dtype=np.int32), np.int32(n - 1))
    corner = i * np.int32(n) + j
    right, up = corner + np.int32(1), corner + np.int32(n)
    faces = np.stack([corner, right, up, up, right, up + np.int32(1)], axis=1).reshape(-1, 3)
    return (
        np.stack([x, y, z], axis=1),
        np.ascontiguousarray(faces[:n_faces]),
        np.clip(colours, 0, 255).astype(np.uint8),
    )
