"""``terraport diff``: what differs between two scenes, or between two versions of one."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.errors import OptionError

if TYPE_CHECKING:
    from terraport_pipeline.upkeep.difference import Compared, Difference
    from terraport_pipeline.upkeep.ground_change import GroundChange

__all__ = ["diff", "register"]

_REGIONS: Final = 20
"""Regions in the table; --json has all."""

_OPTION_LENGTH: Final = 60
"""Characters of an option's value in the table."""

_VERSION_DIGITS: Final = 12
"""Of a version, as its folder is called."""

_TROUBLE: Final = 2
"""Exit status of errors, as diff(1) has it: 1 says that they differ."""


def register(app: typer.Typer) -> None:
    """Add ``terraport diff`` to the command line `app`."""
    app.command("diff")(diff)


def diff(
    first: Annotated[
        str, typer.Argument(metavar="A", help="A scene, or its address.", show_default=False)
    ],
    second: Annotated[
        str | None,
        typer.Argument(
            metavar="[B]",
            help="Another. Without it: the version before of A, against the one published now.",
            show_default=False,
        ),
    ] = None,
    heights: Annotated[
        bool, typer.Option(help="Compare the heights of the ground where segments differ.")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Compare two scenes: segments, what a client has to load, regions, heights, options.

    A segment is kept where number and bytes are the same: a client that has been in A does not load
    it again for B. Regions are compared by their stable ids. Heights are compared from straight
    above, where segments differ, on at most a million pixels: least and greatest change. Volumes of
    cut and fill are those of the build, of a survey that was built over the one before: without B.

    Exit status 0: the same version under the same labels. 1: they differ. 2: an error.

    For example:

        terraport diff scenes/may scenes/june

        terraport diff scenes/pit                     what the last build changed

        terraport diff scenes/pit s3://bucket/scenes/pit || terraport upload scenes/pit s3://bucket/scenes/pit

        terraport diff scenes/may scenes/june --json | jq .load_bytes
    """
    errors = Console(stderr=True, soft_wrap=True)
    try:
        with reporting_errors(errors):
            facts, difference = _compare(first, second, errors, with_heights=heights)
    except typer.Exit as end:
        raise typer.Exit(_TROUBLE if end.exit_code == 1 else end.exit_code) from end
    if as_json:
        typer.echo(json.dumps(facts, indent=1))
    else:
        _show(Console(soft_wrap=True), facts, difference)
    if not difference.is_same:
        raise typer.Exit(1)


def _compare(
    first: str, second: str | None, errors: Console, *, with_heights: bool
) -> tuple[dict[str, Any], Difference]:
    """Open both, compare them, and put together what is said."""
    from terraport_pipeline.progress import NullProgress, RichProgress
    from terraport_pipeline.upkeep.difference import compare, of_folder_before, of_scene
    from terraport_pipeline.upkeep.ground_change import ground_change, why_not
    from terraport_store import Scene, is_url

    with ExitStack() as opened:
        now = opened.enter_context(Scene.open(first))
        problem, ground = None, None
        if second is None:
            if is_url(first):
                raise OptionError(f"{first}: expected a second scene to compare it with")
            sides = of_folder_before(Path(first), now.manifest), of_scene(now, first)
            problem = "only the manifest of the published version is kept"
        else:
            other = opened.enter_context(Scene.open(second))
            sides = of_scene(now, first), of_scene(other, second)
            problem = why_not(now.manifest, other.manifest)
        difference = compare(*sides)
        if not with_heights:
            problem = "not asked for"
        if second is not None and problem is None and now.manifest != other.manifest:
            with RichProgress(errors) as bar:
                progress = bar if errors.is_terminal else NullProgress()
                ground = ground_change((now, other), difference, progress)
    return _facts(sides, difference, ground, problem), difference


def _facts(
    sides: tuple[Compared, Compared],
    difference: Difference,
    ground: GroundChange | None,
    problem: str | None,
) -> dict[str, Any]:
    """Return what ``--json`` prints."""
    from terraport_pipeline.upkeep.difference import side_facts

    first, second = (side_facts(side) for side in sides)
    shares = ("kept", "changed", "new", "gone", "renumbered")
    change = sides[1].regions.get("change") if sides[0].manifest is None else None
    return {
        "same": difference.is_same,
        "a": first,
        "b": second,
        "segments": {name: asdict(getattr(difference, name)) for name in shares},
        "load_bytes": difference.load_bytes,
        "regions": {
            "kept": difference.regions_kept,
            "differing": list(difference.regions),
            "problem": difference.regions_problem,
        },
        "heights": None if ground is None else asdict(ground),
        "heights_problem": problem,
        # A build over the previous version measures it; two separate scenes have no such volumes.
        "change": change.get("whole") if isinstance(change, dict) else None,
        "options": {name: list(values) for name, values in difference.options.items()},
    }


def _show(console: Console, facts: dict[str, Any], difference: Difference) -> None:
    from terraport_pipeline.option import format_bytes

    if difference.is_same:
        console.print(f"the same: version {facts['a']['version'][:12]}", highlight=False)
        return
    console.print(_sides(facts["a"], facts["b"]))
    console.print(_segments(facts))
    console.print(
        f"a client with A in its cache loads {format_bytes(facts['load_bytes'])} for all of B",
        highlight=False,
    )
    for line in _ground_lines(facts):
        console.print(line, markup=False, highlight=False)
    _show_regions(console, facts["regions"])
    _show_options(console, facts["options"])


def _sides(first: dict[str, Any], second: dict[str, Any]) -> Table:
    """Draw a row per fact, A beside B; what is the same stands dim."""
    from terraport_pipeline.option import format_bytes

    table = _plain_table("", "A", "B")

    def row(name: str, one: str, other: str) -> None:
        style = "dim" if one == other else ""
        table.add_row(name, Text(one, style), Text(other, style))

    row("scene", *(side["location"] for side in (first, second)))
    row("version", *(side["version"][:_VERSION_DIGITS] for side in (first, second)))
    row("CRS", *(side["crs"] or "-" for side in (first, second)))
    for name, key in (
        ("triangles", "faces"),
        ("of the base", "base_faces"),
        ("segments", "segments"),
        ("regions", "regions"),
    ):
        row(name, *("-" if side[key] is None else f"{side[key]:,}" for side in (first, second)))
    row("payloads", *(format_bytes(side["payload_bytes"]) for side in (first, second)))
    for axis in ("east", "north", "height"):
        spans = []
        for side in (first, second):
            extent = side["extent"]
            unit = "" if extent is None else extent["height_unit" if axis == "height" else "unit"]
            span = "-" if extent is None else "{:,.2f} .. {:,.2f} ".format(*extent[axis]) + unit
            spans.append(span)
        row(axis, *spans)
    return table


def _segments(facts: dict[str, Any]) -> Table:
    from terraport_pipeline.option import format_bytes

    table = _plain_table("segments", "number", "bytes")
    for column in table.columns[1:]:
        column.justify = "right"
    names = {
        "kept": "kept",
        "changed": "changed",
        "new": "new in B",
        "gone": "gone from A",
        "renumbered": "of these in A by another number",
    }
    for key, name in names.items():
        share = facts["segments"][key]
        if key != "renumbered" or share["segments"]:
            table.add_row(name, f"{share['segments']:,}", format_bytes(share["bytes"]))
    return table


def _ground_lines(facts: dict[str, Any]) -> list[str]:
    lines = []
    ground = facts["heights"]
    if ground is not None:
        lines.append(
            f"heights: {ground['lowest_m']:+,.2f} to {ground['highest_m']:+,.2f} m on "
            f"{ground['area_m2']:,.0f} m² where segments differ (pixels of {ground['step_m']:g} m)"
            "; for volumes of cut and fill build the survey of B over the scene A"
        )
    elif facts["segments"]["kept"]["segments"] == facts["a"]["segments"] == facts["b"]["segments"]:
        lines.append("heights: the same, every segment is kept")
    elif facts["heights_problem"] is not None:
        lines.append(f"heights: not compared, {facts['heights_problem']}")
    else:
        lines.append("heights: no ground of both where segments differ")
    measured = facts["change"]
    if measured is not None:
        lines.append(
            f"volumes of the build: cut {measured['cut_m3']:,.1f} m³, fill "
            f"{measured['fill_m3']:,.1f} m³, each ± {measured['uncertainty_m3']:,.1f} m³"
        )
    return lines


def _show_regions(console: Console, regions: dict[str, Any]) -> None:
    if regions["problem"] is not None:
        console.print(f"regions: not compared, {regions['problem']}", markup=False, highlight=False)
        return
    rows = regions["differing"]
    console.print(
        f"regions: {regions['kept']:,} kept, {len(rows):,} differ", markup=False, highlight=False
    )
    if not rows:
        return
    table = _plain_table("stable id", "", "label", "surface m² in A", "surface m² in B")
    for row in rows[:_REGIONS]:
        label = row["label"] if row["label"] is not None else row["label_before"]
        if row["state"] == "renamed" or (row["label_before"] or label) != label:
            label = f"{row['label_before'] or '(none)'} -> {row['label'] or '(none)'}"
        areas = (row["surface_area_before_m2"], row["surface_area_m2"])
        cells = ("" if area is None else f"{area:,.0f}" for area in areas)
        table.add_row(str(row["stable_id"]), row["state"], Text(label), *cells)
    console.print(table)
    if len(rows) > _REGIONS:
        console.print(f"... and {len(rows) - _REGIONS:,} more (--json lists them)")


def _show_options(console: Console, options: dict[str, Any]) -> None:
    if not options:
        return
    table = _plain_table("option", "A", "B")
    for name, values in options.items():
        table.add_row(name, *(Text(_shortened(value)) for value in values))
    console.print(table)


def _shortened(value: Any) -> str:
    text = (
        "-"
        if value is None
        else json.dumps(value)
        if isinstance(value, dict | list)
        else str(value)
    )
    return text if len(text) <= _OPTION_LENGTH else f"{text[: _OPTION_LENGTH - 3]}..."


def _plain_table(*columns: str) -> Table:
    table = Table(box=None, header_style="dim", pad_edge=False, padding=(0, 2, 0, 0))
    for name in columns:
        table.add_column(name, overflow="fold")
    return table
