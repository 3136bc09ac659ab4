"""``terraport synth``: make a synthetic quarry to try everything else with."""

from __future__ import annotations

import re
import shlex
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.console import Console
from rich.table import Table

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.cli.from_options import command_of, options_of
from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import Section
from terraport_pipeline.synth.options import FlightOptions, QuarryOptions

if TYPE_CHECKING:
    from terraport_pipeline.synth.files import WrittenQuarry
    from terraport_pipeline.synth.options import QuarryOptions
    from terraport_pipeline.synth.photo_files import WrittenPhotos

__all__ = ["parse_size", "register", "synth"]

_FLIGHT: Final = FlightOptions()


def register(app: typer.Typer) -> None:
    """Add ``terraport synth`` to the command line `app`."""
    app.command("synth")(command_of(synth))


def _take_parameters(context: typer.Context, path: Path | None) -> Path | None:
    """Make a file's values the defaults of this call: what is stated beside it wins."""
    from terraport_pipeline.synth.options import QuarryOptions

    if path is not None:
        with reporting_errors(Console(stderr=True, soft_wrap=True)):
            quarry = QuarryOptions.from_json(path)
        fields = [field for _, field in options_of(QuarryOptions)]
        context.default_map = {field.key: getattr(quarry, field.name) for field in fields}
    return path


def synth(
    options: QuarryOptions,
    flight: Annotated[FlightOptions, Section("Photos")],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="Survey to write (.laz or .las); the truth goes beside it."
        ),
    ],
    parameters: Annotated[  # noqa: ARG001  its callback has read it before the options are made
        Path | None,
        typer.Option(
            help="JSON file of options, e.g. data/sample_quarry.json; flags override it.",
            callback=_take_parameters,
            is_eager=True,
        ),
    ] = None,
    photos: Annotated[
        Path | None,
        typer.Option(
            help="Folder to write a drone's photos of the quarry to, with their cameras and truth.",
            show_default=False,
        ),
    ] = None,
    photo_size: Annotated[
        str, typer.Option(help="Width and height of a photo, pixels.", rich_help_panel="Photos")
    ] = f"{_FLIGHT.width}x{_FLIGHT.height}",
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that are there.")] = False,
) -> None:
    """Make a synthetic open-pit quarry: a survey as a drone would bring it, and its truth.

    Benches, a haul road winding down, a lake, stockpiles, a highwall with real overhangs, boulders
    and trees, in UTM coordinates with RGB and an ore grade per point. The same options give the
    same bytes.

    NAME.laz is the survey. NAME.truth.npz holds what no survey knows: the material of each point,
    its place before noise, and the parameters that make the surface again.

    --photos also flies over it: a grid of nadir photos and two orbits of oblique ones, with lens
    distortion, exposure drift, vignetting and a truck that stands elsewhere in every photo. Photos
    show a pattern finer than any cloud (gravel, cracks, targets), and the cloud is coloured by it.

    For example:

        terraport synth -o quarry.laz

        terraport synth -o big.laz --points 5M --seed 3

        terraport synth -o clean.laz --noise 0 --outliers 0 --holes 0 --uneven 0

        terraport synth -o quarry.laz --points 1M --photos quarry-photos --photo-size 1200x900

        terraport build quarry.laz -o scenes/quarry
    """
    # (1) with photos, their pixels decide how finely the ground is coloured
    from terraport_pipeline.progress import RichProgress
    from terraport_pipeline.synth.files import write_quarry
    from terraport_pipeline.synth.flight import seen_by
    from terraport_pipeline.synth.photo_files import write_photos

    flown = None
    if photos is not None:
        width, height = parse_size(photo_size)
        flown = replace(flight, width=width, height=height)
        options = seen_by(flown, options)
    # (2) write; nothing that is there is overwritten without --force
    photo_set = None
    with RichProgress(Console(stderr=True, soft_wrap=True)) as progress:
        start = time.perf_counter()
        quarry = write_quarry(options, output, overwrite=force, progress=progress)
        seconds = time.perf_counter() - start
        start = time.perf_counter()
        if flown is not None and photos is not None:
            photo_set = write_photos(
                options,
                flown,
                photos,
                survey=output.name,
                overwrite=force,
                progress=progress,
            )
        photo_seconds = time.perf_counter() - start
    table = _make_table(quarry, options, seconds)
    if photo_set is not None:
        _add_photos(table, photo_set, photo_seconds)
    console = Console(soft_wrap=True)
    console.print(table)
    # Below the table, whose width would break it: to be copied.
    console.print(f"Next: {_next_command(quarry, photo_set)}", markup=False, highlight=False)


def _next_command(quarry: WrittenQuarry, photo_set: WrittenPhotos | None) -> str:
    """Say how to build a scene of what was written."""
    words: list[str | Path] = ["terraport", "build", quarry.survey_path, "-o", "scenes/quarry"]
    if photo_set is not None:
        words += ["--photos", photo_set.directory / "images"]
        words += ["--cameras", photo_set.directory / "colmap"]
    return shlex.join(map(str, words))


def parse_size(text: str) -> tuple[int, int]:
    """Read a picture size such as ``2000x1500``.

    Raises
    ------
    OptionError
        When the text is none.

    Examples
    --------
    >>> parse_size("2000x1500")
    (2000, 1500)
    """
    match = re.fullmatch(r"([0-9]{1,6})\s*[xX]\s*([0-9]{1,6})", text.strip())
    if match is None:
        raise OptionError(f"photo size is {text!r}, expected width and height such as 2000x1500")
    return int(match[1]), int(match[2])


def _add_photos(table: Table, photo_set: WrittenPhotos, seconds: float) -> None:
    low, high = photo_set.exposure_ev
    table.add_row("photos", f"{photo_set.directory}  {photo_set.bytes / 1e6:,.1f} MB")
    table.add_row(
        "  number", f"{photo_set.photos} ({photo_set.nadir} nadir), {photo_set.megapixels:,.0f} Mpx"
    )
    table.add_row(
        "  flight",
        f"{photo_set.height_m:,.0f} m above the plateau, {photo_set.gsd_m * 100:.1f} cm a pixel",
    )
    table.add_row("  exposure", f"{low:+.2f} to {high:+.2f} stops")
    table.add_row("  with the truck", f"{photo_set.truck_photos}")
    table.add_row("  time", f"{seconds:,.1f} s  ({photo_set.megapixels / seconds:,.2f} Mpx/s)")


def _make_table(quarry: WrittenQuarry, options: QuarryOptions, seconds: float) -> Table:
    table = Table(title="Synthetic quarry", show_header=False, title_justify="left")
    table.add_column()
    table.add_column(justify="right")
    west, south, low, east, north, high = quarry.bounds_m
    table.add_row("survey", f"{quarry.survey_path}  {quarry.survey_bytes / 1e6:,.1f} MB")
    table.add_row("truth", f"{quarry.truth_path}  {quarry.truth_bytes / 1e6:,.1f} MB")
    table.add_row("points", f"{quarry.points:,}")
    table.add_row("easting", f"{west:,.2f} .. {east:,.2f} m  (EPSG:{options.epsg})")
    table.add_row("northing", f"{south:,.2f} .. {north:,.2f} m")
    table.add_row("height", f"{low:,.2f} .. {high:,.2f} m")
    for name, count in quarry.material_points.items():
        table.add_row(f"  {name}", f"{count:,}  {100.0 * count / quarry.points:5.1f} %")
    table.add_row("time", f"{seconds:,.1f} s  ({quarry.points / seconds:,.0f} points/s)")
    return table
