"""What ``terraport land`` says of its landings: a table, or JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from terraport.frames import to_crs
from terraport.landing import Landing
from terraport.session import Session

__all__ = ["landing_facts", "print_report", "report_facts"]

_LETTERS: Final = {"east": "E", "west": "W", "north": "N", "south": "S", "up": "H", "down": "D"}
"""Letter of a coordinate, by the direction in which it increases."""


async def report_facts(
    session: Session,
    position: tuple[float, float, float],
    manifest: dict[str, Any],
    facts_of_landings: list[dict[str, Any]],
) -> dict[str, Any]:
    """Return the members that every report has, as ``--json`` names them."""
    return {
        "scene": {
            "id": session.scene.id,
            "name": session.scene.name,
            "version": session.scene.version,
            "url": session.url,
        },
        "position": list(position),
        "position_crs": list(to_crs(position, manifest["origin"], manifest.get("survey_units"))),
        "survey_units": manifest.get("survey_units"),
        "landings": facts_of_landings,
        "visible_set_hash": await session.visible_set_hash(),
    }


def landing_facts(landing: Landing) -> dict[str, Any]:
    """Return plan and statistics of one landing, as ``--json`` names them."""
    plan = landing.plan
    return {
        "radius_m": plan.radius_m,
        "effective_radius_m": plan.effective_radius_m,
        "load_segments": len(plan.load),
        "load_bytes": plan.load_bytes,
        "load_triangles": plan.load_triangles,
        "keep_segments": len(plan.keep),
        "total_bytes": plan.total_bytes,
        "total_triangles": plan.total_triangles,
        "omitted_segments": plan.omitted_segments,
        "omitted_by": plan.omitted_by,
        "outside_m": landing.outside_m,
        **asdict(landing.stats),
    }


def print_report(facts: dict[str, Any], landing: Landing) -> None:
    """Print the report of :func:`report_facts`; `landing` is the last one."""
    console = Console()
    scene, landings = facts["scene"], facts["landings"]
    axes = (facts["survey_units"] or {}).get("axes") or ("east", "north", "up")
    place = ", ".join(
        f"{_LETTERS[axis]} {value:,.2f}"
        for axis, value in zip(axes, facts["position_crs"], strict=True)
    )
    position = ", ".join(f"{value:,.2f}" for value in facts["position"])
    console.print(f"[bold]{scene['name']}[/]  version {scene['version'][:12]}")
    units = "" if facts["survey_units"] is None else " in the survey's own units"
    console.print(f"landed at {position} m  ({place}{units})")
    table = Table("", *(f"landing {number}" for number in range(1, len(landings) + 1)), box=None)
    for column in table.columns[1:]:
        column.justify = "right"
    for label, cell in _ROWS:
        table.add_row(label, *(cell(landing_facts) for landing_facts in landings))
    console.print(table)
    group = facts.get("group")
    if group is not None:
        ready_names = ", ".join(group["ready"]) or "nobody"
        console.print(f"group {group['name']} ({group['role']}): {ready_names} ready")
        for state in ("degraded", "missing"):
            if group[state]:
                console.print(f"{state}: {', '.join(group[state])}", style="yellow")
    console.print(f"visible set {facts['visible_set_hash']}", style="dim")
    if landing.plan.omitted_segments:
        console.print(
            f"{landing.plan.omitted_segments} segments left out by {landing.plan.omitted_by}: "
            f"whole to {landing.plan.effective_radius_m:,.1f} m",
            style="yellow",
        )
    for file in facts.get("files", []):
        size = f"  {_bytes(file['bytes'])}" if "bytes" in file else ""
        console.print(f"wrote {file['file']}{size}", highlight=False)


def _bytes(count: float) -> str:
    return f"{count / 1e6:,.2f} MB" if count >= 1e5 else f"{count:,.0f} B"


def _milliseconds(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds * 1000:,.1f} ms"


def _speed(landing: dict[str, Any]) -> str:
    if not landing["streamed_bytes"] or not landing["ready_s"]:
        return "-"
    return f"{landing['streamed_bytes'] / landing['ready_s'] / 1e6:,.1f} MB/s"


_ROWS: Final = (
    ("radius", lambda landing: f"{landing['radius_m']:g} m"),
    ("to load", lambda landing: f"{landing['load_segments']:,} segments"),
    ("", lambda landing: f"{landing['load_triangles']:,} triangles"),
    ("", lambda landing: _bytes(landing["load_bytes"])),
    ("held already", lambda landing: f"{landing['keep_segments']:,} segments"),
    ("shown", lambda landing: f"{landing['total_triangles']:,} triangles"),
    ("", lambda landing: _bytes(landing["total_bytes"])),
    ("streamed", lambda landing: _bytes(landing["streamed_bytes"])),
    ("plan after", lambda landing: _milliseconds(landing["plan_s"])),
    ("first segment after", lambda landing: _milliseconds(landing["first_segment_s"])),
    ("ready after", lambda landing: _milliseconds(landing["ready_s"])),
    ("speed", _speed),
)
"""Label and cell of each row of the table."""
