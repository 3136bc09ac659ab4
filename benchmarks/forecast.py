"""What ``terraport inspect`` forecasts of a build, beside what the build took.

Every survey is built by the command (scene, report, all), watched from outside, and inspected with
the same memory and cores. The forecast's coefficients are fitted here, too: with `--fit` by least
squares of relative errors over all builds, and again without the build that is looked at, which
says how a survey fares that nothing was fitted to.

    python benchmarks/forecast.py SURVEY... --max-memory 8G --keep measured.jsonl
    python benchmarks/forecast.py --measured measured.jsonl [SURVEY...] --fit
    python benchmarks/forecast.py --smoke                          a hill of 20,000 points

A line of `--measured` is JSON: ``path``, ``points``, ``faces``, ``wall`` (s), ``peak`` (MiB),
``bytes`` (scene) and ``work`` (bytes, may be missing).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from parts.deliveries import measure, quarry_of, write_delivery
from scipy.optimize import nnls

from terraport_pipeline.option import parse_bytes
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.sample.survey_sample import sample_survey
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.workflow.build_forecast import (
    SECONDS,
    BuildForecast,
    forecast_build,
    time_terms,
)


@dataclass(frozen=True)
class Row:
    """One survey."""

    name: str
    measured: dict[str, Any]
    forecast: BuildForecast
    terms: tuple[float, ...]


def build(path: Path, max_memory: str) -> dict[str, Any]:
    """Build a survey, and say what it took."""
    folder = Path(tempfile.mkdtemp(prefix="benchmark-forecast-"))
    try:
        scene = folder / "scene"
        command = [str(Path(sys.executable).with_name("terraport")), "build", str(path)]
        options = ["-o", str(scene), "--quiet", "--no-resume", "--max-memory", max_memory]
        took = measure([*command, *options], scene)
        counts = json.loads((scene / "scene.json").read_bytes())["counts"]
        scene_bytes = sum(file.stat().st_size for file in scene.rglob("*") if file.is_file())
        return {
            "path": str(path),
            "points": counts["points"],
            "faces": counts["detail_faces"],
            "wall": round(took.wall_s, 1),
            "cpu": round(took.cpu_s, 1),
            "peak": took.peak_bytes >> 20,
            "bytes": scene_bytes,
            "work": took.disk_bytes - scene_bytes,
        }
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def look(measured: dict[str, Any], max_memory_bytes: int, threads: int) -> Row:
    """Forecast a build that was measured."""
    path = Path(measured["path"])
    survey, heads = find_survey(path).heads(NullProgress())
    sample = sample_survey(survey, heads, max_memory_bytes=max_memory_bytes, threads=threads)
    forecast = forecast_build(sample.ground, max_memory_bytes=max_memory_bytes, threads=threads)
    name = path.parent.name if path.stem in ("model", "scene") else path.stem.split(".")[0]
    return Row(name, measured, forecast, time_terms(sample.ground))


def off(forecast: float, measured: float | None) -> str:
    """Forecast, measured and the error."""
    if not measured:
        return f"{forecast:,.3g} / -"
    return f"{forecast:,.3g} / {measured:,.3g} ({forecast / measured - 1:+.0%})"


def print_table(rows: list[Row]) -> None:
    """Print forecast / measured (error) of every survey."""
    print("| survey | points, M | faces, M | time, s | memory, MiB | scene, MB | work, MB |")
    print("| -- | -- | -- | -- | -- | -- | -- |")
    for row in rows:
        made, took = row.forecast, row.measured
        cells = [
            off(made.faces / 1e6, took["faces"] / 1e6),
            off(made.seconds, took["wall"]),
            off(made.memory_bytes / 2**20, took["peak"]),
            off(made.scene_bytes / 1e6, took["bytes"] / 1e6),
            off(made.work_bytes / 1e6, took.get("work", 0) / 1e6),
        ]
        print(f"| {row.name} | {took['points'] / 1e6:.2f} | {' | '.join(cells)} |")


def fit(rows: list[Row]) -> np.ndarray:
    """Fit the seconds to all terms but the last, least squares of relative errors, none below 0."""
    terms = np.array([row.terms for row in rows])
    wall = np.array([row.measured["wall"] for row in rows])
    rest = wall - SECONDS[-1] * terms[:, -1]
    return np.append(nnls(terms[:, :-1] / wall[:, None], rest / wall)[0], SECONDS[-1])


def print_fit(rows: list[Row]) -> None:
    """Print coefficients of the time, and the error of each build by a fit without it."""
    names = ("fixed", "several tiles", "per point", "per face", "per smoothed pair")
    each = ", ".join(f"{n} {value:.3g}" for n, value in zip(names, fit(rows), strict=True))
    print(f"\nseconds: {each}")
    for row in rows:
        others = fit([other for other in rows if other is not row])
        seconds, wall = float(others @ np.array(row.terms)), row.measured["wall"]
        error = f"{seconds:.0f} s of {wall:.0f} ({seconds / wall - 1:+.0%})"
        print(f"{row.name}: fitted without it {error}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("surveys", nargs="*", type=Path)
    parser.add_argument("--measured", type=Path, help="builds that were measured before")
    parser.add_argument("--keep", type=Path, help="file to add measured builds to")
    parser.add_argument("--max-memory", default="8G")
    parser.add_argument("--fit", action="store_true", help="fit the time's coefficients")
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    surveys, scratch = list(arguments.surveys), None
    if arguments.smoke:
        scratch = Path(tempfile.mkdtemp(prefix="benchmark-forecast-"))
        surveys = [write_delivery(quarry_of(20_000), 2, scratch / "quarry")]
    try:
        lines = arguments.measured.read_text().splitlines() if arguments.measured else []
        measured = [json.loads(line) for line in lines]
        for path in surveys:
            measured.append(build(path, arguments.max_memory))
            if arguments.keep:
                with arguments.keep.open("a") as file:
                    file.write(json.dumps(measured[-1]) + "\n")
        memory = parse_bytes(arguments.max_memory, "--max-memory")
        rows = [look(row, memory, os.cpu_count() or 1) for row in measured]
        print_table(rows)
        if arguments.fit:
            print_fit(rows)
    finally:
        if scratch is not None:
            shutil.rmtree(scratch, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
