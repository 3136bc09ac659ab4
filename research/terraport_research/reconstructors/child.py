"""One algorithm on one cloud in a process of its own: measured, bounded, and apart from the rest.

The process is forked from one that has imported everything (``multiprocessing``'s fork server): a
fresh interpreter would spend two seconds on that each time. The time counts from when everything is
imported and compiled; the memory is what the algorithm added to that, with the programs that it
starts.
"""

from __future__ import annotations

import json
import os
import resource
import sys
from pathlib import Path

import numba
import numpy as np
import psutil

from terraport_pipeline.errors import PipelineError
from terraport_pipeline.measure import Measure
from terraport_research.reconstructors import RECONSTRUCTORS
from terraport_research.reconstructors.contract import Samples, Work

__all__ = ["main"]

_FAILED = 3
"""Exit code of an expected failure; facts.json says which."""


def main(key: str, folder: str, threads: int, depth: int) -> None:
    """Read ``samples.npz`` of a folder, reconstruct, write ``surface.npz`` and ``facts.json``.

    Leaves with an exit code that is not 0 when there is no surface; facts.json then says why, or
    output.txt what was printed.
    """
    # (1) Standard error goes to a file from the start: a crash of native code prints there.
    directory = Path(folder)
    with (directory / "output.txt").open("wb") as log:
        os.dup2(log.fileno(), 2)
    numba.set_num_threads(max(1, min(threads, os.cpu_count() or 1)))
    # (2) Input; kernels are compiled before the clock starts.
    with np.load(directory / "samples.npz") as stored:
        samples = Samples(
            stored["points"],
            stored["normals"],
            stored["colours"],
            stored["local_spacing_m"],
            float(stored["spacing_m"]),
        )
    work = Work(directory, threads, depth or None)
    algorithm = RECONSTRUCTORS[key]
    if key != "poisson":  # compiles, or loads what was compiled before
        algorithm.run(_ball(), Work(directory, 1))
    # (3) The run itself, measured as what it adds.
    before_bytes = psutil.Process().memory_info().rss
    before_s = _cpu_s()
    try:
        with Measure() as measure:
            surface = algorithm.run(samples, work)
    except PipelineError as error:
        (directory / "facts.json").write_text(json.dumps({"error": str(error)}))
        sys.exit(_FAILED)
    # (4) Surface and facts; the parent reads them only after exit code 0.
    facts = {
        "cpu_s": _cpu_s() - before_s,
        "wall_s": measure.seconds,
        "added_bytes": max(0, measure.peak_bytes - before_bytes),
        "note": surface.note,
        "solved_faces": surface.solved_faces,
    }
    if surface.sample is None:
        np.savez(directory / "surface.npz", vertices=surface.vertices, faces=surface.faces)
    else:
        np.savez(
            directory / "surface.npz",
            vertices=surface.vertices,
            faces=surface.faces,
            sample=surface.sample,
        )
    (directory / "facts.json").write_text(json.dumps(facts))


def _cpu_s() -> float:
    """CPU seconds of this process and its finished children."""
    own, children = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def _ball() -> Samples:
    """Make a few samples of a sphere, to warm up on."""
    normals = np.random.default_rng(0).normal(size=(64, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    spacing = np.full(64, 0.45, np.float32)
    return Samples(normals, normals, np.zeros((64, 3), np.uint8), spacing, 0.45)
