"""Cameras as tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from rich.console import Group
from rich.table import Table
from rich.text import Text

__all__ = ["camera_tables"]

_LENSES: Final = 10
"""Lenses in the table; --json has all."""

_IDLE: Final = 5
"""Idle photos that are named; --json has all."""

_GOOD_COLOURS: Final = 0.5
"""Correlation of brightness below which the cameras are likely off (right ones: 0.7 to 0.9)."""


def camera_tables(found: Mapping[str, Any], name: str) -> Group:
    """Draw what :mod:`terraport_pipeline.camera_inspection` found."""
    heading = Text.assemble((name, "bold"), f"  {found['format']}, {found['count']:,} photos")
    warnings = [Text(f"to know: {text}", style="yellow") for text in found["warnings"]]
    return Group(heading, _summary(found), _lenses(found["lenses"]), *warnings)


def _summary(found: Mapping[str, Any]) -> Table:
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    if "coverage" not in found:
        for frame in found["frames"]:
            table.add_row("coordinates", f"perhaps {frame}")
        low, high = found["centres"]["min"], found["centres"]["max"]
        for axis, (first, last) in zip("xyz", zip(low, high, strict=True), strict=True):
            table.add_row(f"cameras {axis}", f"{first:,.2f} .. {last:,.2f}")
        return table
    coverage, pixel, height = found["coverage"], found["pixel_m"], found["height_above_m"]
    table.add_row("coordinates", found["frame"])
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
    if found["idle"]:
        names = ", ".join(found["idle"][:_IDLE])
        table.add_row("photos of nothing", f"{len(found['idle']):,} ({names})")
    if found["colours"] is not None:
        median = found["colours"]["median"]
        told = "" if median >= _GOOD_COLOURS else ": the cameras may be off"
        table.add_row("colours agree", f"{median:.2f} (1 is perfect){told}")
    return table


def _lenses(lenses: list[dict[str, Any]]) -> Table:
    table = Table(title="Lenses", title_justify="left", title_style="bold")
    for name in ("photos", "pixels", "focal px", "kind", "corner", "valid to"):
        table.add_column(name, justify="right")
    for one in lenses[:_LENSES]:
        corner = "beyond" if one["corner_deg"] is None else f"{one['corner_deg']:.1f}°"
        focal = " x ".join(f"{value:,.1f}" for value in one["focal_px"])
        kind = one["model"] + (", distorted" if one["distorted"] else "")
        size = " x ".join(map(str, one["size"]))
        table.add_row(f"{one['photos']:,}", size, focal, kind, corner, f"{one['valid_deg']:.1f}°")
    if len(lenses) > _LENSES:
        table.add_row(f"and {len(lenses) - _LENSES:,} more", "", "", "", "", "")
    return table
