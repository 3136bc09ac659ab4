"""``terraport evaluate``: algorithms side by side, on data whose truth is known."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.errors import OptionError
from terraport_pipeline.evaluation.page import write_page
from terraport_pipeline.evaluation.reconstruction import (
    MODELS,
    Compared,
    Evaluation,
    Options,
    evaluate,
    to_json,
)
from terraport_pipeline.option import parse_count
from terraport_pipeline.progress import NullProgress, RichProgress
from terraport_pipeline.report_facts import format_bytes

__all__ = ["reconstruction", "register"]

_DEFAULTS: Final = Options()
_QUICK_POINTS: Final = 5_000
_QUICK_DEPTHS: Final = (6, 7, 8)

_app = typer.Typer(
    name="evaluate",
    help="Compare algorithms with each other and with the thesis, on data whose truth is known.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)


def register(app: typer.Typer) -> None:
    """Add ``terraport evaluate`` and its commands to the command line `app`."""
    app.add_typer(_app, name="evaluate")


@_app.callback()
def _group() -> None:
    """Keep `evaluate` a group while it has one command."""


@_app.command("reconstruction")
def reconstruction(
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for reconstruction.html, .json, pictures."),
    ] = Path("evaluation"),
    data: Annotated[
        Path | None,
        typer.Option(
            help="Folder with real data: stanford/bunny.ply, stanford/armadillo.obj, "
            "red_rocks/red_rocks.laz, apaxco_quarry/apaxco_quarry_500k.laz. What is not there is "
            "left out, and said."
        ),
    ] = None,
    points: Annotated[
        str, typer.Option(help="Samples of each model and of the quarry: 20k.")
    ] = f"{_DEFAULTS.points}",
    algorithms: Annotated[
        str, typer.Option(help="Which, by commas; none: only the depths.")
    ] = ",".join(_DEFAULTS.algorithms),
    models: Annotated[
        str,
        typer.Option(
            help="Models with truth: bunny, armadillo, block, gear, stairs, torus, sphere."
        ),
    ] = ",".join(MODELS),
    depths: Annotated[
        str, typer.Option(help="Octree depths of Poisson, by commas; none: only the algorithms.")
    ] = ",".join(map(str, _DEFAULTS.depths)),
    depth_points: Annotated[
        str, typer.Option(help="Points of each scene that the depths are tried on.")
    ] = f"{_DEFAULTS.depth_points}",
    scenes: Annotated[
        str,
        typer.Option(help="Those scenes: quarry, red_rocks, apaxco_quarry, or paths of surveys."),
    ] = ",".join(_DEFAULTS.scenes),
    threads: Annotated[
        int | None, typer.Option(help="Reconstructions at once.  [all cores]", min=1, max=64)
    ] = None,
    time_limit_s: Annotated[
        float, typer.Option("--time-limit", help="Stop an algorithm after this many seconds.")
    ] = _DEFAULTS.time_limit_s,
    quick: Annotated[
        bool, typer.Option("--quick", help="5,000 points, depths 6 to 8: a look in a minute.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no tables.")] = False,
) -> None:
    """Compare six reconstruction algorithms: colour, holes, accuracy, time, memory.

    Delaunay triangulation, marching cubes, Voronoi filtering, ball pivoting, Poisson and greedy
    projection, on models and a synthetic quarry whose surfaces are known, as the thesis's Tables
    3.1 and 3.2; and Poisson's faces against its octree depth, as its Figure 5.8. Three to four
    minutes on two cores.

    For example:

        terraport evaluate reconstruction --quick

        terraport evaluate reconstruction --data data --algorithms poisson,ball-pivoting

        terraport evaluate reconstruction --algorithms none --scenes pit.laz --depth-points 500k
    """
    errors, console = Console(stderr=True, soft_wrap=True), Console()
    with reporting_errors(errors):
        # (1) options are refused before anything is made
        options = Options(
            algorithms=_names(algorithms),
            models=_names(models),
            points=_QUICK_POINTS if quick else parse_count(points, "points"),
            depths=_QUICK_DEPTHS if quick else _numbers(depths),
            depth_points=_QUICK_POINTS if quick else parse_count(depth_points, "depth points"),
            scenes=_names(scenes),
            data=data,
            threads=threads or os.cpu_count() or 1,
            time_limit_s=time_limit_s,
        )
        output.mkdir(parents=True, exist_ok=True)
        # (2) minutes of work; an algorithm that fails or takes too long is a result, no error
        if quiet:
            evaluation = evaluate(options, NullProgress())
        else:
            with RichProgress(errors) as progress:
                evaluation = evaluate(options, progress)
        # (3) files first, so that nothing is lost to a closed terminal
        _write(evaluation, output)
        if not quiet:
            _print_tables(console, evaluation)
            console.print(f"written: {output / 'reconstruction.html'}", highlight=False)


def _names(text: str) -> tuple[str, ...]:
    names = tuple(word.strip() for word in text.split(",") if word.strip())
    return () if names == ("none",) else names


def _numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(sorted({int(word) for word in _names(text)}))
    except ValueError as error:
        raise OptionError(f"depths {text!r}; expected whole numbers, for example 8,9,10") from error


def _write(evaluation: Evaluation, output: Path) -> None:
    write_page(evaluation, output / "reconstruction.html")
    (output / "reconstruction.json").write_text(to_json(evaluation), encoding="utf-8")
    pictures = output / "pictures"
    pictures.mkdir(exist_ok=True)
    for compared in (*([evaluation.ground] if evaluation.ground else []), *evaluation.models):
        for name, jpeg in (("cloud", compared.picture), ("truth", compared.truth_picture)):
            if jpeg is not None:
                (pictures / f"{compared.key}-{name}.jpg").write_bytes(jpeg)
        for result in compared.results:
            if result.picture is not None:
                (pictures / f"{compared.key}-{result.algorithm}.jpg").write_bytes(result.picture)


def _print_tables(console: Console, evaluation: Evaluation) -> None:
    for reason in (*evaluation.skipped, *evaluation.missing.values()):
        console.print(Text(f"not run: {reason}", style="yellow"))
    if evaluation.ground is not None:
        console.print(_colour_table(evaluation))
        console.print(_measured(evaluation.ground))
    if evaluation.models:
        console.print(_shape_table(evaluation))
        for compared in evaluation.models:
            console.print(_measured(compared))
    if evaluation.scenes:
        console.print(_depth_table(evaluation))


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left")
    for number, name in enumerate(columns):
        table.add_column(name, justify="right" if number else "left", no_wrap=number == 0)
    return table


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _colour_table(evaluation: Evaluation) -> Table:
    table = _table(
        "Is the colour kept? (Table 3.1, grey levels)",
        *("algorithm", "95 % differ by", "allowed", "lost", "kept", "thesis: kept"),
    )
    for key, row in evaluation.colour.items():
        table.add_row(
            key,
            f"{row.difference_p95:.0f}",
            f"{row.allowed_p95:.0f}",
            f"{100 * row.lost:.2f} %",
            _yes(row.kept),
            _yes(row.thesis_kept),
        )
    return table


def _shape_table(evaluation: Evaluation) -> Table:
    table = _table(
        "Holes and likeness on all models (Table 3.2, distances in spacings)",
        *("algorithm", "holes", "to truth p95", "from truth p95", "verdict", "thesis"),
    )
    for key, row in evaluation.shape.items():
        thesis = "not tried"
        if row.thesis is not None:
            thesis = "proceed" if row.thesis[1] and not row.thesis[0] else "eliminated"
        table.add_row(
            key,
            f"{row.holes:,}",
            f"{row.worst_to_truth_p95:.2f}",
            f"{row.worst_from_truth_p95:.2f}",
            "proceed" if row.proceed else "eliminated",
            thesis,
        )
    return table


def _measured(compared: Compared) -> Table:
    table = _table(
        f"{compared.title}: {compared.points:,} samples, distances in spacings",
        *("algorithm", "faces", "to truth p95", "from truth p95", "most", "holes"),
        *("CPU s", "memory"),
    )
    for result in compared.results:
        scores = result.scores
        if scores is None:
            table.add_row(result.algorithm, *["-"] * 7)
            continue
        table.add_row(
            result.algorithm,
            f"{scores.faces:,}",
            f"{scores.to_truth.p95:.2f}",
            f"{scores.from_truth.p95:.2f}",
            f"{scores.hausdorff:.1f}",
            f"{scores.holes:,}",
            f"{result.run.cpu_s:.1f}",
            format_bytes(result.run.added_bytes),
        )
    return table


def _depth_table(evaluation: Evaluation) -> Table:
    table = _table(
        "Poisson by octree depth (Figure 5.8; * what a build takes)",
        *("scene", "depth", "faces", "per point", "CPU s", "memory"),
    )
    for scene in evaluation.scenes:
        for row in scene.rows:
            mark = " *" if row.depth == scene.our_depth else ""
            table.add_row(
                scene.title,
                f"{row.depth}{mark}",
                row.error or f"{row.faces:,}",
                f"{row.faces / scene.points:.1f}",
                f"{row.cpu_s:.1f}",
                format_bytes(row.memory_bytes),
            )
    return table
