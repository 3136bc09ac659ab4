"""Cameras as tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from rich.console import Group
from rich.table import Table
from rich.text import Text

from terraport_pipeline.cli.survey_tables import forecast_table

__all__ = ["camera_tables"]

_LENSES: Final = 10
"""Lenses in the table; --json has all."""

_IDLE: Final = 5
"""Idle photos that are named; --json has all."""

_GOOD_COLOURS: Final = 0.5
"""Correlation of brightness below which the cameras are likely off (right ones: 0.7 to 0.9)."""


def camera_tables(facts: Mapping[str, Any], name: str) -> Group:
    """Draw the facts about cameras: coordinates, how well they fit the cloud, lenses, warnings.

    Parameters
    ----------
    facts : mapping
        From :mod:`terraport_pipeline.camera_inspection`, with or without a survey.
    name : str
        Of the cameras' file or folder.
    """
    heading = Text.assemble((name, "bold"), f"  {facts['format']}, {facts['count']:,} photos")
    warnings = [Text(f"to know: {text}", style="yellow") for text in facts["warnings"]]
    forecast = facts.get("forecast")
    textured = [] if forecast is None else [forecast_table(forecast, "A build with these photos")]
    return Group(heading, _summary(facts), _lenses(facts["lenses"]), *textured, *warnings)


def _summary(facts: Mapping[str, Any]) -> Table:
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    if "coverage" not in facts:
        for frame in facts["frames"]:
            table.add_row("coordinates", f"perhaps {frame}")
        low, high = facts["centres"]["min"], facts["centres"]["max"]
        for axis, (first, last) in zip("xyz", zip(low, high, strict=True), strict=True):
            table.add_row(f"cameras {axis}", f"{first:,.2f} .. {last:,.2f}")
        return table
    coverage, pixel, height = facts["coverage"], facts["pixel_m"], facts["height_above_m"]
    table.add_row("coordinates", facts["frame"])
    table.add_row("cameras above", f"{height['median']:,.1f} m over the middle of the cloud")
    table.add_row("cloud in photos", f"{coverage['share']:.1%}")
    per_point = coverage["photos_per_point"]
    table.add_row(
        "photos per point",
        f"{per_point['median']:,.0f} ({per_point['p5']:,.0f} .. {per_point['p95']:,.0f})",
    )
    table.add_row(
        "pixel on the ground",
        f"{pixel['median'] * 1000:,.1f} mm ({pixel['p5'] * 1000:,.1f} .. "
        f"{pixel['p95'] * 1000:,.1f})",
    )
    if facts["idle"]:
        names = ", ".join(facts["idle"][:_IDLE])
        table.add_row("photos of nothing", f"{len(facts['idle']):,} ({names})")
    if facts["colours"] is not None:
        median = facts["colours"]["median"]
        doubt = "" if median >= _GOOD_COLOURS else ": the cameras may be off"
        table.add_row("colours agree", f"{median:.2f} (1 is perfect){doubt}")
    return table


def _lenses(lenses: list[dict[str, Any]]) -> Table:
    table = Table(title="Lenses", title_justify="left", title_style="bold")
    for name in ("photos", "pixels", "focal px", "kind", "corner", "valid to"):
        table.add_column(name, justify="right")
    for lens in lenses[:_LENSES]:
        corner = "beyond" if lens["corner_deg"] is None else f"{lens['corner_deg']:.1f}°"
        focal = " x ".join(f"{value:,.1f}" for value in lens["focal_px"])
        kind = lens["model"] + (", distorted" if lens["distorted"] else "")
        size = " x ".join(map(str, lens["size"]))
        table.add_row(f"{lens['photos']:,}", size, focal, kind, corner, f"{lens['valid_deg']:.1f}°")
    if len(lenses) > _LENSES:
        table.add_row(f"and {len(lenses) - _LENSES:,} more", "", "", "", "", "")
    return table
