"""Runs algorithms in child processes: measured, with a time limit, one not disturbing the other."""

from __future__ import annotations

import json
import multiprocessing
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import psutil
from scipy.spatial import cKDTree

from terraport_payload.types import UInt8
from terraport_pipeline.geometry.clouds.carry import carry_values
from terraport_research.options import TIME_LIMIT_S
from terraport_research.reconstructors import (
    RECONSTRUCTORS,
    Reconstructor,
    Samples,
    Surface,
)
from terraport_research.reconstructors.child import main as child_main

__all__ = ["Run", "run"]

_SERVER: Final = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["terraport_research.reconstructors.child"])


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Surface, cost or error of one algorithm on one cloud."""

    algorithm: Reconstructor
    surface: Surface | None
    """None where there is none; `error` says why."""
    colours: UInt8 | None
    """(V, 3) sRGB: the samples' own where vertices are samples, else carried from the nearest."""
    cpu_s: float = 0.0
    wall_s: float = 0.0
    added_bytes: int = 0
    """Memory at its highest above what the process held before it began."""
    error: str = ""


def run(
    key: str,
    samples: Samples,
    scratch: Path,
    *,
    threads: int = 1,
    depth: int | None = None,
    time_limit_s: float = TIME_LIMIT_S,
) -> Run:
    """Run one algorithm.

    Parameters
    ----------
    key : str
        Of :data:`RECONSTRUCTORS`.
    samples : Samples
    scratch : Path
        Existing folder; what is written there is deleted before this returns.
    threads : int
        For the algorithm; 1 measures CPU time best.
    depth : int, optional
        Octree depth of Poisson.
    time_limit_s : float
        The child is stopped after this.

    Returns
    -------
    Run
        Never raises for what the algorithm does: a failure is a result.
    """
    algorithm = RECONSTRUCTORS[key]
    with tempfile.TemporaryDirectory(dir=scratch) as folder:
        # (1) The input goes through a file, the algorithm runs in a child: a crash, a leak or a
        # hang stays there.
        directory = Path(folder)
        np.savez(
            directory / "samples.npz",
            points=samples.points,
            normals=samples.normals,
            colours=samples.colours,
            local_spacing_m=samples.local_spacing_m,
            spacing_m=samples.spacing_m,
        )
        child = _SERVER.Process(
            target=child_main, args=(key, str(directory), threads, depth or 0), daemon=True
        )
        child.start()
        child.join(time_limit_s)
        if child.exitcode is None:
            _kill(child.pid)
            child.join()
            return Run(algorithm, None, None, error=f"not done after {time_limit_s:g} s: stopped")
        # (2) What came of it.
        facts_path = directory / "facts.json"
        facts = json.loads(facts_path.read_text()) if facts_path.is_file() else {}
        if child.exitcode:
            reason = (
                facts.get("error")
                or f"ended with exit code {child.exitcode}: {_last_output(directory)}"
            )
            return Run(algorithm, None, None, error=reason)
        with np.load(directory / "surface.npz") as stored:
            arrays = dict(stored)
    surface = Surface(
        arrays["vertices"],
        arrays["faces"],
        arrays.get("sample"),
        facts["note"],
        facts["solved_faces"],
    )
    if not len(surface.faces):
        return Run(algorithm, None, None, error="made no face")
    return Run(
        algorithm,
        surface,
        _colours(surface, samples),
        facts["cpu_s"],
        facts["wall_s"],
        facts["added_bytes"],
    )


def _last_output(directory: Path) -> str:
    """Return the last 400 bytes that a child printed to standard error."""
    path = directory / "output.txt"
    output = path.read_bytes() if path.is_file() else b""
    return output[-400:].decode("utf-8", "replace").strip() or "it printed nothing"


def _kill(pid: int | None) -> None:
    """End a process with the programs that it started."""
    try:
        process = psutil.Process(pid)
        for one in (*process.children(recursive=True), process):
            one.kill()
    except psutil.NoSuchProcess:
        pass


def _colours(surface: Surface, samples: Samples) -> UInt8:
    if surface.sample is not None:
        return samples.colours[surface.sample]
    tree = cKDTree(samples.points, balanced_tree=False)
    carried, _ = carry_values(tree, samples.colours, {}, surface.vertices, workers=1)
    return carried
