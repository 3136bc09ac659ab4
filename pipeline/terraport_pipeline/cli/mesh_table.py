"""The facts of a mesh as a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

__all__ = ["mesh_table"]

_SHOWN = 3


def mesh_table(facts: Mapping[str, Any]) -> Group:
    """Draw what :func:`~terraport_pipeline.mesh_inspection.inspect_mesh` found, faults first."""
    rows = {
        "mesh": f"{facts['faces']:,} triangles, {facts['vertices']:,} vertices, {facts['parts']:,} "
        f"part{'s' * (facts['parts'] != 1)}, {facts['pieces']:,} "
        f"separate piece{'s' * (facts['pieces'] != 1)}",
        "border": f"{facts['open_edges']:,} open edges" if facts["open_edges"] else "closed",
        "edges": f"{facts['median_edge']:.4g} long in the middle",
    }
    if facts["polygons"]:
        rows["polygons"] = f"{facts['polygons']:,} faces with more than 3 corners, cut into fans"
    rows["colours"] = facts["colours"]
    rows["attributes"] = ", ".join(facts["attributes"]) or "none"
    textures = facts["textures"]
    rows["textures"] = "none"
    if textures is not None:
        images = textures["images"]
        sizes = ", ".join(f"{i['name']} {i['width']} x {i['height']}" for i in images[:_SHOWN])
        more = f" and {len(images) - _SHOWN:,} more" if len(images) > _SHOWN else ""
        rows["textures"] = f"{len(images):,}: {sizes}{more}"
        rows["texel"] = f"{textures['texel']:.4g} wide; {textures['faces_without']:,} faces without"
    rows["read with"] = ", ".join(facts["files"][: 2 * _SHOWN]) or "nothing beside it"
    place = facts["place"]
    if place is not None:
        low, high = place["low"], place["high"]
        rows["up"] = place["up"]
        added = " ".join(f"{value:.3f}" for value in place["shift"])
        rows["shift"] = (
            f"{added}, by {place['shift_from']}" if place["shift_from"] else "none stated"
        )
        rows["coordinates"] = place["crs"] or "not stated"
        for axis, name in enumerate(("east", "north", "height")):
            rows[name] = f"{low[axis]:,.3f} .. {high[axis]:,.3f} m"
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    for name, value in rows.items():
        table.add_row(name, value)
    refused = [] if facts["refused"] is None else [Text(f"refused: {facts['refused']}", "red")]
    warnings = [Text(f"to know: {text}", style="yellow") for text in facts["warnings"]]
    return Group(Text(str(facts["file"]), "bold"), *refused, *warnings, table)
