"""Areas and volumes by name: of all regions that are called the same, together. PURE."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from terraport_pipeline.report.survey_units import SurveyUnit

__all__ = ["MAX_NAMES", "name_table"]

MAX_NAMES: Final = 40
"""Names that the table lists, largest area first."""

_WITHOUT: Final = "without a name"


def name_table(
    rows: Sequence[dict[str, Any]], unit: SurveyUnit
) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Add up regions by their label.

    Parameters
    ----------
    rows : sequence of dict
        From ``region_rows``.
    unit : SurveyUnit

    Returns
    -------
    columns : tuple of str
        Behind the name; volumes only of a scene that was built over another, the confidence only
        of one that was taught.
    table : tuple of tuple of str
        A name and its cells; empty where no region has a name. What has none comes last.
    """
    if not any(row["label"] for row in rows):
        return (), ()
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(row["label"], []).append(row)
    whole = sum(row["surface_area_m2"] or 0.0 for row in rows)
    has_volumes = any("cut_m3" in row for row in rows)
    has_confidence = any(row.get("confidence") is not None for row in rows)
    columns = ["regions", f"plan area {unit.name}²", f"surface area {unit.name}²", "share"]
    if has_volumes:
        columns += [f"{name} {unit.volume_name}" for name in ("cut", "fill", "±")]
    if has_confidence:
        columns.append("confidence")

    def area(name: str) -> float:
        return sum(row["surface_area_m2"] or 0.0 for row in groups[name])

    ordered = sorted(groups, key=lambda name: (not name, -area(name), name))
    table = []
    for name in ordered[:MAX_NAMES]:
        of_name = groups[name]
        cells = [
            name or _WITHOUT,
            f"{len(of_name):,}",
            unit.area_value(sum(row["plan_area_m2"] or 0.0 for row in of_name)),
            unit.area_value(area(name)),
            f"{100 * area(name) / whole:.1f} %" if whole else "",
        ]
        if has_volumes:
            # Uncertainties are added up as shared errors, so that none is too small.
            for key in ("cut_m3", "fill_m3", "change_uncertainty_m3"):
                volume = sum(row.get(key) or 0.0 for row in of_name)
                cells.append(unit.volume_value(volume))
        if has_confidence:
            cells.append(_confidence(of_name))
        table.append(tuple(cells))
    return tuple(columns), tuple(table)


def _confidence(rows: Sequence[dict[str, Any]]) -> str:
    known = [
        (r["surface_area_m2"] or 0.0, r["confidence"])
        for r in rows
        if r.get("confidence") is not None
    ]
    total = sum(area for area, _ in known)
    return f"{sum(area * value for area, value in known) / total:.2f}" if total else ""
