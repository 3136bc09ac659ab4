"""``terraport synth``: make a synthetic quarry to try everything else with."""

from __future__ import annotations

import dataclasses
import re
import time
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console
from rich.table import Table

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import parse_count
from terraport_pipeline.progress import RichProgress
from terraport_pipeline.synth.files import WrittenQuarry, write_quarry
from terraport_pipeline.synth.flight import FlightOptions, seen_by
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.photo_files import WrittenPhotos, write_photos

__all__ = ["parse_size", "register", "synth"]

_DEFAULTS: Final = QuarryOptions()
_FLIGHT: Final = FlightOptions()


def register(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("synth")(synth)


def synth(
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="Survey to write (.laz or .las); the truth goes beside it."
        ),
    ],
    points: Annotated[
        str | None,
        typer.Option(help="Points, exactly: 300000, 300k, 5M (50k to 20M is sensible).  [300k]"),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(help=f"Decides everything random.  [{_DEFAULTS.seed}]"),
    ] = None,
    size: Annotated[
        float | None,
        typer.Option(
            help="East-west side of the site in metres; everything scales with it.  "
            f"[{_DEFAULTS.size_m:g}]"
        ),
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option(
            help=f"Position error per axis, metres (standard deviation).  [{_DEFAULTS.noise_m:g}]"
        ),
    ] = None,
    colour_noise: Annotated[
        float | None,
        typer.Option(help=f"Colour error, grey levels of 255.  [{_DEFAULTS.colour_noise:g}]"),
    ] = None,
    outliers: Annotated[
        float | None,
        typer.Option(help=f"Share of stray points, 0 to 0.2.  [{_DEFAULTS.outlier_fraction:g}]"),
    ] = None,
    detail: Annotated[
        float | None,
        typer.Option(help="Patterns finer than a cloud's spacing, 0 to 2.  [0; with --photos 1]"),
    ] = None,
    holes: Annotated[
        int | None,
        typer.Option(help=f"Round areas without points.  [{_DEFAULTS.holes}]"),
    ] = None,
    shadows: Annotated[
        float | None,
        typer.Option(
            help=f"How dark unlit ground is: 0 albedo only, 1 black.  [{_DEFAULTS.shadows:g}]"
        ),
    ] = None,
    contrast: Annotated[
        float | None,
        typer.Option(
            help=f"Factor on colour differences between materials.  [{_DEFAULTS.contrast:g}]"
        ),
    ] = None,
    texture: Annotated[
        float | None,
        typer.Option(help=f"Factor on patterns within a material.  [{_DEFAULTS.texture:g}]"),
    ] = None,
    uneven: Annotated[
        float | None,
        typer.Option(help=f"How patchy the density is, 0 to 0.95.  [{_DEFAULTS.uneven:g}]"),
    ] = None,
    parameters: Annotated[
        Path | None,
        typer.Option(help="JSON file of options, e.g. data/sample_quarry.json; flags override it."),
    ] = None,
    photos: Annotated[
        Path | None,
        typer.Option(
            help="Folder to write a drone's photos of the quarry to, with their cameras and truth.",
            show_default=False,
        ),
    ] = None,
    photo_count: Annotated[int, typer.Option(help="Photos.", min=1)] = _FLIGHT.count,
    photo_size: Annotated[
        str, typer.Option(help="Width and height of a photo, pixels.")
    ] = f"{_FLIGHT.width}x{_FLIGHT.height}",
    overlap: Annotated[
        float, typer.Option(help="Of neighbouring nadir photos, 0 to 0.95.")
    ] = _FLIGHT.overlap,
    exposure_drift: Annotated[
        float, typer.Option(help="Largest exposure error of a photo, stops.")
    ] = _FLIGHT.exposure_drift_ev,
    truck: Annotated[
        bool, typer.Option("--truck/--no-truck", help="A truck drives through the photos.")
    ] = _FLIGHT.truck,
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
    console = Console(stderr=True, soft_wrap=True)
    with reporting_errors(console):
        # (1) the quarry: defaults, over them the file of parameters, over it what was stated here
        values: dict[str, Any] = {
            "points": None if points is None else parse_count(points, "points"),
            "seed": seed,
            "size_m": size,
            "noise_m": noise,
            "colour_noise": colour_noise,
            "outlier_fraction": outliers,
            "holes": holes,
            "shadows": shadows,
            "contrast": contrast,
            "texture": texture,
            "detail": detail,
            "uneven": uneven,
        }
        stated = {name: value for name, value in values.items() if value is not None}
        base = _DEFAULTS if parameters is None else QuarryOptions.from_json(parameters)
        options = dataclasses.replace(base, **stated)
        # (2) the flight: its photos also decide how finely the ground is coloured
        flight = None
        if photos is not None:
            flight = FlightOptions(
                count=photo_count,
                **parse_size(photo_size),
                overlap=overlap,
                exposure_drift_ev=exposure_drift,
                truck=truck,
            )
            options = seen_by(flight, options)
        # (3) write; nothing that is there is overwritten without --force
        photo_set = None
        with RichProgress(console) as progress:
            start = time.perf_counter()
            quarry = write_quarry(options, output, overwrite=force, progress=progress)
            seconds = time.perf_counter() - start
            start = time.perf_counter()
            if flight is not None and photos is not None:
                photo_set = write_photos(
                    options,
                    flight,
                    photos,
                    survey=output.name,
                    overwrite=force,
                    progress=progress,
                )
            photo_seconds = time.perf_counter() - start
    table = _make_table(quarry, options, seconds)
    if photo_set is not None:
        _add_photos(table, photo_set, photo_seconds)
        table.caption = (
            f"Next: terraport build {output} -o scenes/quarry "
            f"--photos {photo_set.directory / 'images'} --cameras {photo_set.directory / 'colmap'}"
        )
    Console(soft_wrap=True).print(table)


def parse_size(text: str) -> dict[str, int]:
    """Read a picture size such as ``2000x1500``.

    Raises
    ------
    OptionError
        When the text is none.

    Examples
    --------
    >>> parse_size("2000x1500")
    {'width': 2000, 'height': 1500}
    """
    match = re.fullmatch(r"([0-9]{1,6})\s*[xX]\s*([0-9]{1,6})", text.strip())
    if match is None:
        raise OptionError(f"photo size is {text!r}, expected width and height such as 2000x1500")
    return {"width": int(match[1]), "height": int(match[2])}


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
    table.caption = f"Next: terraport build {quarry.survey_path} -o scenes/quarry"
    return table
