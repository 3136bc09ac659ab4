"""Deliveries of LAZ files, and builds of them that are watched from outside."""

from __future__ import annotations

import json
import math
import os
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import psutil
from parts.core_demand import CoreDemand

from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.options import QuarryOptions

__all__ = ["Measured", "measure", "quarry_of", "write_delivery"]

_SIDE_M = 360.0
"""East-west side of the quarry of 1 M points."""

_ROWS_AT_ONCE = 2_000_000

_LOOK_S = 0.1
"""Between two looks at a build's processes."""


@dataclass(frozen=True)
class Measured:
    """One build."""

    points: int
    files: int
    wall_s: float
    cpu_s: float
    peak_bytes: int
    """Resident memory of the command and its children, at most, looked at often."""
    disk_bytes: int
    """Of scene and work directory at the end."""
    report: dict[str, Any]
    """``build.json``."""
    quiet_s: float
    """What it would have taken with the machine to itself; see :mod:`.core_demand`."""
    busy: float
    """Share of all cores' time that it would have used then."""

    @property
    def stages_s(self) -> float:
        """Wall time up to the scene's publication: without the report."""
        return float(self.report["seconds"])


def quarry_of(points: int, sample_seed: int = 0) -> QuarryOptions:
    """Describe a quarry that grows with its points, so that their spacing stays."""
    size_m = _SIDE_M * math.sqrt(points / 1e6)
    return QuarryOptions(points=points, size_m=max(20.0, size_m), sample_seed=sample_seed)


def write_delivery(quarry: QuarryOptions, side: int, delivery: Path) -> Path:
    """Write a quarry as side * side LAZ files; a delivery that is there stays."""
    if delivery.exists():
        return delivery
    whole = delivery.with_name(f"{delivery.name}.laz")
    beside = delivery.with_name(f".{delivery.name}.part")
    write_quarry(quarry, whole, overwrite=True)
    beside.mkdir(parents=True, exist_ok=True)
    with laspy.open(whole) as reader:
        low, high = reader.header.mins[:2], reader.header.maxs[:2]
        writers = {
            (i, j): laspy.open(beside / f"tile-{i}-{j}.laz", mode="w", header=reader.header)
            for i in range(side)
            for j in range(side)
        }
        for rows in reader.chunk_iterator(_ROWS_AT_ONCE):
            share = (np.stack([rows.x, rows.y], axis=1) - low) / (high - low)
            column, row = np.minimum((share * side).astype(int), side - 1).T
            for (i, j), writer in writers.items():
                inside = (column == i) & (row == j)
                if inside.any():
                    writer.write_points(rows[inside])
        for writer in writers.values():
            writer.close()
    whole.unlink()
    whole.with_suffix(".truth.npz").unlink()
    beside.rename(delivery)
    return delivery


def measure(command: list[str], scene: Path, points: int = 0, files: int = 0) -> Measured:
    """Run a build and watch its memory."""
    began, before = time.monotonic(), os.times()
    child = psutil.Popen(command)
    peak, demand = 0, CoreDemand(os.cpu_count() or 1)
    ended = threading.Event()

    def watch() -> None:
        nonlocal peak
        while not ended.wait(_LOOK_S):
            total, processes = 0, [child, *_children(child)]
            demand.look(process.pid for process in processes)
            for process in processes:
                try:
                    total += process.memory_info().rss
                except psutil.Error:
                    continue
            peak = max(peak, total)

    watcher = threading.Thread(target=watch)
    watcher.start()
    code = child.wait()
    ended.set()
    watcher.join()
    if code:
        raise SystemExit(f"{' '.join(command)} ended with {code}")
    after = os.times()
    cpu_s = after.children_user + after.children_system
    cpu_s -= before.children_user + before.children_system
    work = scene.with_name(f".{scene.name}.work")
    return Measured(
        points, files, time.monotonic() - began, cpu_s, peak,
        _bytes_in(scene) + _bytes_in(work), json.loads((scene / "build.json").read_bytes()),
        demand.quiet_s, demand.busy,
    )  # fmt: skip


def _children(process: psutil.Process) -> list[psutil.Process]:
    try:
        children: list[psutil.Process] = process.children(recursive=True)
    except psutil.Error:
        return []
    return children


def _bytes_in(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
