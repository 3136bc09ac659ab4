"""``terraport validate``: is a scene whole, and does its hand-off leave holes."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.engines.gltf_validator import PACKAGE

if TYPE_CHECKING:
    from terraport_pipeline.validate.handoff_report import HandOffReport
    from terraport_pipeline.validate.level_mixes import LevelMixReport
    from terraport_pipeline.validate.validation import ValidationResult

__all__ = ["register", "validate_command"]

MAX_SHOWN: Final = 20
"""Findings printed; ``--json`` has all of them."""


def register(app: typer.Typer) -> None:
    """Add ``terraport validate`` to the command line `app`."""
    app.command("validate")(validate_command)


def validate_command(
    scene: Annotated[
        str,
        typer.Argument(
            help="Scene directory, or a scene's address (s3://...).", show_default=False
        ),
    ],
    rays: Annotated[
        int,
        typer.Option(
            help="Rays that look for holes; 0: none. Of a scene with two levels as many again look "
            "at mixes of them."
        ),
    ] = 1_000_000,
    subsets: Annotated[int, typer.Option(help="Random sets of loaded segments.")] = 100,
    seed: Annotated[int, typer.Option(help="Same seed, same rays.")] = 0,
    khronos: Annotated[
        bool,
        typer.Option(
            "--khronos",
            help="Run the Khronos glTF validator on a sample. Needs Node and, the first time, the "
            f"network: npm fetches {PACKAGE} into the user's cache. Without it nothing is fetched.",
        ),
    ] = False,
    sample: Annotated[int, typer.Option(help="Segments that it looks at.", min=1)] = 32,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="Write a PNG of the worst place: full detail, mixed model, difference.",
            show_default=False,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Check a scene: every hash and payload, holes between base and detail, the glTF.

    The hand-off is proved by rays: straight down, oblique, and from eye height, at random sets of
    loaded segments. A ray that meets the full detail must meet what a client would show. Of a scene
    with two levels a second proof takes each segment at either.

    Exit code 0: nothing found. 1: something is wrong. 2: wrong options.

    For example:

        terraport validate scenes/quarry

        terraport validate scenes/quarry --rays 100000 --subsets 20

        terraport validate scenes/quarry --khronos

        terraport validate scenes/quarry --picture worst.png
    """
    # Findings about the scene go to standard output and into the exit code; what keeps the check
    # from being made at all is an error.
    from terraport_pipeline.progress import RichProgress
    from terraport_pipeline.validate.handoff_report import HandOffOptions
    from terraport_pipeline.validate.validation import ValidationOptions, validate
    from terraport_store import is_url

    errors = Console(stderr=True)
    start = time.perf_counter()
    with reporting_errors(errors):
        options = ValidationOptions(
            HandOffOptions(rays, subsets, seed) if rays else None, khronos, sample, picture
        )
        with RichProgress(errors) as progress:
            result = validate(
                scene if is_url(scene) else Path(scene),
                options,
                progress=progress,
                announce=lambda line: errors.print(line, markup=False, highlight=False),
            )
    seconds = time.perf_counter() - start
    if as_json:
        typer.echo(json.dumps(_plain(result), indent=1))
    else:
        _show(Console(), result, seconds)
    if result.problems:
        raise typer.Exit(1)


def _show(console: Console, result: ValidationResult, seconds: float) -> None:
    version = result.manifest.version[:12] if result.manifest else "not readable"
    table = Table(title=f"{Path(result.path).name}  version {version}", title_justify="left")
    table.add_column("check")
    table.add_column("result")
    table.add_column("found", overflow="fold")
    broken = sum(finding.severity == "error" for finding in result.findings)
    counts = result.manifest.counts if result.manifest else None
    seen = f"{counts.segments:,} payloads, every hash, count and box" if counts else ""
    table.add_row("store", _verdict(broken), seen if not broken else f"{broken:,} errors")
    report = result.hand_off
    if report is None:
        table.add_row("hand-off", Text("not run", "yellow"), result.hand_off_not_run)
    else:
        line = _hand_off_line(report) + f"; {_rate(result):,.0f} rays/s"
        table.add_row("hand-off", _verdict(report.holes), line)
    levels = result.levels
    if levels is not None:
        table.add_row("levels", _verdict(levels.holes), _levels_line(levels))
    elif result.manifest is not None and result.manifest.levels > 1:
        table.add_row("levels", Text("not run", "yellow"), result.levels_not_run)
    gltf = result.gltf
    if gltf.not_run:
        table.add_row("glTF (Khronos)", Text("not run", "yellow"), gltf.not_run)
    else:
        table.add_row(
            "glTF (Khronos)",
            _verdict(gltf.errors),
            f"{gltf.checked} payloads: {gltf.errors} errors, {gltf.warnings} warnings",
        )
    table.caption = f"{seconds:,.1f} s"
    console.print(table)
    if report is not None:
        console.print(_kinds(report))
        _show_worst(console, result)
    for finding in result.findings[:MAX_SHOWN]:
        console.print(str(finding), markup=False, highlight=False)
    for message in gltf.messages[:MAX_SHOWN]:
        console.print(f"glTF {message.name}: {message.code}: {message.text}", markup=False)
    left = len(result.findings) - MAX_SHOWN
    if left > 0:
        console.print(f"... and {left:,} more findings (--json lists them)")


def _hand_off_line(report: HandOffReport) -> str:
    distance = report.distance_m
    holes = f"{report.holes:,} holes ({report.holes_per_million:,.1f} per million rays)"
    if report.holes:
        holes += f": {report.holes_hidden:,} hidden too early, {report.holes_uncovered:,} no base"
    windows = f" in {report.windows} windows" if report.windows > 1 else ""
    return (
        f"{holes} in {report.hits:,} rays over {report.subsets} subsets{windows}; "
        f"distance p50 {distance['p50']:.3g} m, p99 {distance['p99']:.3g} m, "
        f"p99.9 {distance['p99.9']:.3g} m, tolerance {report.tolerance_m:.3g} m"
    )


def _levels_line(report: LevelMixReport) -> str:
    distance = report.distance_m
    where = ", ".join(f"({x:.2f}, {y:.2f}, {z:.2f})" for x, y, z in report.hole_places)
    return (
        f"{report.holes:,} holes in {report.hits:,} rays over {report.mixes} mixes of levels and "
        f"base{f', at {where} scene m' if where else ''}; the coarser level lies p50 "
        f"{distance['p50']:.3g} m, p99 {distance['p99']:.3g} m from the detail"
    )


def _kinds(report: HandOffReport) -> Table:
    table = Table(title="Rays", title_justify="left")
    for name in ("from", "cast", "met detail", "strict misses", "holes"):
        table.add_column(name, justify="left" if name == "from" else "right")
    for kind in report.kinds:
        table.add_row(
            kind.kind,
            *(f"{n:,}" for n in (kind.rays, kind.hits, kind.strict_misses, kind.holes)),
        )
    table.caption = (
        f"{report.base_misses:,} strict misses miss the whole base too (outlines), of which "
        f"{report.under_base:,} with the eye below it; "
        f"{report.smoothed:,} rays at things the base smooths away; "
        f"rim: base before loaded detail at {report.overlap:.1%} of the hits on it"
    )
    table.caption_justify = "left"
    return table


def _show_worst(console: Console, result: ValidationResult) -> None:
    from terraport_pipeline.validate.worst_place import describe, to_survey

    worst = result.hand_off.worst if result.hand_off else None
    if worst is None or result.manifest is None:
        return
    scene, survey = (
        ", ".join(f"{value:.2f}" for value in position)
        for position in (worst.target, to_survey(result.manifest.origin, worst.target))
    )
    console.print(
        f"worst place: {describe(worst)}; at ({scene}) scene m, ({survey}) in the survey's "
        f"coordinates; {worst.kind} ray, {len(worst.loaded):,} segments loaded",
        highlight=False,
    )
    if result.picture is not None:
        console.print(f"picture of it: {result.picture}", markup=False, highlight=False)


def _rate(result: ValidationResult) -> float:
    """Rays per second of wall time, judgement included."""
    rays = result.hand_off.rays if result.hand_off else 0
    return rays / result.hand_off_seconds if result.hand_off_seconds > 0 else 0.0


def _verdict(problems: int) -> Text:
    return Text("failed", "bold red") if problems else Text("good", "green")


def _plain(result: ValidationResult) -> dict[str, Any]:
    report = result.hand_off
    return {
        "scene": str(result.path),
        "version": result.manifest.version if result.manifest else None,
        "problems": result.problems,
        "findings": [asdict(finding) for finding in result.findings],
        "hand_off": None
        if report is None
        else {
            **asdict(report),
            "holes": report.holes,
            "holes_per_million": report.holes_per_million,
            # JSON has no infinity: a distance that was not found is null.
            "distance_m": _finite(report.distance_m),
            "down_distance_m": _finite(report.down_distance_m),
            "worst": _plain_worst(result),
            "seconds": result.hand_off_seconds,
            "rays_per_second": _rate(result),
        },
        "picture": None if result.picture is None else str(result.picture),
        "hand_off_not_run": result.hand_off_not_run,
        "levels": None
        if result.levels is None
        else {**asdict(result.levels), "distance_m": _finite(result.levels.distance_m)},
        "levels_not_run": result.levels_not_run,
        "gltf": asdict(result.gltf),
    }


def _plain_worst(result: ValidationResult) -> dict[str, Any] | None:
    from terraport_pipeline.validate.worst_place import to_survey

    worst = result.hand_off.worst if result.hand_off else None
    if worst is None or result.manifest is None:
        return None
    survey = to_survey(result.manifest.origin, worst.target)
    return {**_finite(asdict(worst)), "target_crs": survey}


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    return {
        key: None if isinstance(value, float) and value in {float("inf"), float("-inf")} else value
        for key, value in values.items()
    }
