"""``terraport evaluate``: algorithms side by side, on data whose truth is known."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from terraport_pipeline.cli.edge import reporting_errors, watching
from terraport_pipeline.cli.from_options import command_of
from terraport_pipeline.option import format_bytes
from terraport_research.options import ReconstructionOptions, SegmentationOptions, ThesisOptions

if TYPE_CHECKING:
    from terraport_research.booklet_model import Table as BookletTable
    from terraport_research.reconstruction import Compared, Evaluation
    from terraport_research.segmentation import SegmentationEvaluation

__all__ = ["reconstruction", "register", "segmentation", "study", "thesis"]

_QUICK_POINTS: Final = 5_000
_QUICK_DEPTHS: Final = (6, 7, 8)

_app = typer.Typer(
    name="evaluate",
    help="Compare algorithms with each other and with the thesis, on data whose truth is known.\n\n"
    "For example:\n\n    terraport evaluate reconstruction --quick\n\n"
    "    terraport evaluate segmentation --models MeshsegBenchmark-1.0",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)


def register(app: typer.Typer) -> None:
    """Add ``terraport evaluate`` and its commands to the command line `app`."""
    app.add_typer(_app, name="evaluate")


def reconstruction(
    options: ReconstructionOptions,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for reconstruction.html, .json, pictures."),
    ] = Path("evaluation"),
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
    from terraport_research.reconstruction import evaluate

    errors, console = Console(stderr=True, soft_wrap=True), Console()
    if quick:
        options = replace(
            options, points=_QUICK_POINTS, depths=_QUICK_DEPTHS, depth_points=_QUICK_POINTS
        )
    output.mkdir(parents=True, exist_ok=True)
    # Minutes of work; an algorithm that fails or takes too long is a result, no error.
    with watching(errors, quiet=quiet) as progress:
        evaluation = evaluate(options, progress)
    # Files first, so that nothing is lost to a closed terminal.
    _write(evaluation, output)
    if not quiet:
        _print_tables(console, evaluation)
        console.print(f"written: {output / 'reconstruction.html'}", highlight=False)


_app.command("reconstruction")(command_of(reconstruction))


def segmentation(
    options: SegmentationOptions,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for segmentation.html, .md, .csv, .json."),
    ] = Path("evaluation"),
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no table.")] = False,
) -> None:
    """Compare segmentation algorithms with people, as Princeton's benchmark does.

    Cut discrepancy, Hamming distance (Rm, Rf), Rand index and consistency errors of every algorithm
    against every person's segmentation, as the thesis's Tables B.1 to B.7, with its values beside.

    The models are Princeton's (MeshsegBenchmark-1.0, academic use); without them four bodies made
    here are cut, which shows how it runs and nothing else.

    For example:

        terraport evaluate segmentation

        terraport evaluate segmentation --models MeshsegBenchmark-1.0 --mode by-model

        terraport evaluate segmentation --models psb.tar.xz --algorithms automatic --every 10
    """
    from terraport_research.segmentation import evaluate_segmentation
    from terraport_research.segmentation_page import write_evaluation

    errors, console = Console(stderr=True, soft_wrap=True), Console()
    with watching(errors, quiet=quiet) as progress:
        evaluation = evaluate_segmentation(options, progress)
    output.mkdir(parents=True, exist_ok=True)
    write_evaluation(evaluation, output)
    if not quiet:
        _print_table(console, _score_table(evaluation))
        console.print(f"written: {output / 'segmentation.html'}", highlight=False)


_app.command("segmentation")(command_of(segmentation))


def thesis(
    options: ThesisOptions,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for thesis.html, .md, .csv, .json, pictures."),
    ] = Path("evaluation"),
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no words.")] = False,
) -> None:
    """Make the thesis's tables and figures again, ours beside what it printed.

    people (Tables B.1 to B.7, Figure 5.12, from a results file), bodies (5.13, 5.14, C.1 to C.9),
    landscapes (5.1 to 5.3, 5.15 to 5.17), pools (5.18 to 5.20), run-times (Table 5.4), depths (5.5
    to 5.7), photos (5.9 to 5.11, A.1 to A.7). Two to four minutes on two cores; each page is kept
    as soon as it is made.

    For example:

        terraport evaluate thesis

        terraport evaluate thesis --pages people --scores evaluation/segmentation.json

        terraport evaluate thesis --pages depths --data data --depths 8,10,11,13
    """
    from terraport_research.thesis.evaluate import evaluate_thesis

    errors, console = Console(stderr=True, soft_wrap=True), Console()
    with watching(errors, quiet=quiet) as progress:
        pages, left_out = evaluate_thesis(options, output, progress)
    if not quiet:
        for reason in left_out:
            console.print(Text(f"not made: {reason}", style="yellow"))
        for page in pages:
            figures = f"{len(page.tables)} tables, {len(page.figures)} figures"
            console.print(f"{page.title}: {figures}", highlight=False)
        console.print(f"written: {output / 'thesis.html'}", highlight=False)


_app.command("thesis")(command_of(thesis))


def study(
    logs: Annotated[
        list[Path] | None,
        typer.Argument(help="Logs of sessions, saved by the study's page.", show_default=False),
    ] = None,
    play: Annotated[
        Path | None,
        typer.Option(
            help="Play a walk over this built scene in both conditions, in Chromium.",
            show_default=False,
            exists=True,
        ),
    ] = None,
    walk: Annotated[
        Path | None,
        typer.Option(
            help="The walk to play: a file of walks, or the log of a live session. Without it one "
            "of three landings is made.",
            show_default=False,
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    radius: Annotated[
        float, typer.Option(help="Of the made walk's landings, metres.", min=1.0, max=500.0)
    ] = 60.0,
    seconds: Annotated[
        float, typer.Option(help="Of the made walk, after each landing.", min=2.0, max=600.0)
    ] = 12.0,
    frames: Annotated[
        int,
        typer.Option(
            help="Frames of each second of the walk, however long they take to draw.", min=5, max=90
        ),
    ] = 30,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for study.html, .md, .csv, .json, and logs."),
    ] = Path("study"),
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no table.")] = False,
) -> None:
    """Compare detail frozen between landings with detail that follows the head.

    Changes of detail per minute of head motion, frames, SSQ and VRSQ, of one session or of many.
    Sessions are logged by the page study.html of terraport serve; --play makes two without anybody,
    along one walk.

    For example:

        terraport evaluate study --play scenes/quarry -o study

        terraport evaluate study logs/study-7-head.json logs/study-7-landings.json
    """
    from terraport_research.study.evaluate import evaluate_study
    from terraport_research.study.playing import play_walk
    from terraport_research.study.walks import made_walk, read_walk

    with reporting_errors(Console(stderr=True, soft_wrap=True)):
        paths = list(logs or [])
        output.mkdir(parents=True, exist_ok=True)
        if play is not None:
            way = read_walk(walk) if walk else made_walk(play, radius, seconds)
            (output / "walk.json").write_text(json.dumps(way) + "\n", encoding="utf-8")
            reach = float(way["legs"][0]["radius_m"])
            with watching(Console(stderr=True, soft_wrap=True), quiet=quiet) as progress:
                paths += play_walk(
                    play, way, output, radius_m=reach, frames_per_s=frames, progress=progress
                )
        page = evaluate_study(paths, output)
    if not quiet:
        console = Console()
        _print_table(console, _booklet_table(page.tables[0]))
        console.print(f"written: {output / 'study.html'}", highlight=False)


_app.command("study")(study)


_WIDEST_TABLE: Final = 1000
"""Maximum width of a table, characters."""


def _booklet_table(table: BookletTable) -> Table:
    printed = _table(table.title, table.head, *(column.title for column in table.columns))
    for row in table.rows:
        cells = [table.cell(row, number) for number in range(len(table.columns))]
        printed.add_row(row.title, *cells)
    return printed


def _score_table(evaluation: SegmentationEvaluation) -> Table:
    from terraport_research.segmentation_page import HEADS

    table = _table(
        f"Against people, k told {evaluation.options.mode} (Tables B.1 to B.7; lower is better)",
        *("algorithm", *HEADS.values(), "segments", "failed", "CPU s"),
    )
    for key in evaluation.algorithms:
        row = evaluation.row(key)
        values = ["-" if math.isnan(value) else f"{value:.3f}" for value in row.scores]
        table.add_row(key, *values, f"{row.segments:.1f}", str(row.failed), f"{row.cpu_s:.1f}")
    return table


def _write(evaluation: Evaluation, output: Path) -> None:
    from terraport_research.page import write_page
    from terraport_research.reconstruction import to_json

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
    for reason in evaluation.skipped:
        console.print(Text(f"not run: {reason}", style="yellow"))
    if evaluation.ground is not None:
        _print_table(console, _colour_table(evaluation))
        _print_table(console, _measured(evaluation.ground))
    if evaluation.models:
        _print_table(console, _shape_table(evaluation))
        for compared in evaluation.models:
            _print_table(console, _measured(compared))
    if evaluation.scenes:
        _print_table(console, _depth_table(evaluation))


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, header_style="dim", padding=(0, 1))
    for number, name in enumerate(columns):
        table.add_column(name, justify="right" if number else "left", no_wrap=True)
    return table


def _print_table(console: Console, table: Table) -> None:
    """Print a table without truncated figures; the terminal wraps lines that are too long."""
    unbounded = console.options.update(width=_WIDEST_TABLE)
    console.width = max(console.width, console.measure(table, options=unbounded).maximum)
    console.print(table)


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
