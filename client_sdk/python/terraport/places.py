"""Regions with a name, as places to go to: "take me to the stockpile"."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from terraport.errors import UsageError

__all__ = ["Place", "find_place", "places_of"]

_RADIUS_M: Final = 60.0
"""Of a landing where the scene says none."""

_LISTED: Final = 8


@dataclass(frozen=True, slots=True)
class Place:
    """A named region, and where to stand to see it."""

    label: str
    """What people call it; several regions may have one name."""
    stable_id: int | None
    region: int
    """Its number in this version, as picks have it."""
    area_m2: float | None
    position: tuple[float, float, float]
    """Metres, scene frame: on the ground where :attr:`is_view`, else the region's middle."""
    heading_deg: float | None
    """Where to look, clockwise from north; None where nobody chose."""
    radius_m: float
    """That shows the region."""
    is_view: bool
    """Whether the position was chosen for its view, on the ground."""
    kind: str | None = None
    """The name that its ground was taught (``terraport teach``); None otherwise."""


def places_of(document: Mapping[str, Any], labels: Mapping[str, Any]) -> tuple[Place, ...]:
    """Read the places of a scene.

    Parameters
    ----------
    document : mapping
        Contents of regions.json.
    labels : mapping
        Contents of labels.json.

    Returns
    -------
    tuple of Place
        Named regions, by name, the largest of each name first. What is not as the format has it is
        left out: a place is a service, not a promise.
    """
    given = {
        row.get("stable_id"): row.get("label")
        for row in _rows(labels.get("labels"))
        if isinstance(row.get("label"), str)
    }
    places = []
    for number, row in enumerate(_rows(document.get("regions"))):
        label = given.get(row.get("stable_id")) or row.get("label")
        if not isinstance(label, str) or not label:
            continue
        view = row.get("place")
        chosen = view if isinstance(view, Mapping) else {}
        position = _triple(chosen.get("position"))
        middle = _triple(row.get("centroid"))
        stands = position or middle
        if stands is None:
            continue
        stable_id, kind = row.get("stable_id"), row.get("class")
        places.append(
            Place(
                label=label,
                stable_id=stable_id if isinstance(stable_id, int) else None,
                region=number,
                area_m2=_number(row.get("area_m2")),
                position=stands,
                heading_deg=None if position is None else _number(chosen.get("heading_deg")),
                radius_m=_number(chosen.get("radius_m")) or _RADIUS_M,
                is_view=position is not None,
                kind=kind if isinstance(kind, str) else None,
            )
        )
    places.sort(key=lambda place: (place.label.casefold(), -(place.area_m2 or 0.0), place.region))
    return tuple(places)


def find_place(places: Sequence[Place], wanted: str) -> Place:
    """Find a place by its name, whatever the case, or by its stable id.

    Returns
    -------
    Place
        Of several regions of that name the largest.

    Raises
    ------
    UsageError
        There is none: the error lists names.
    """
    text = wanted.strip().casefold()
    for place in places:
        if place.label.casefold() == text:
            return place
    for place in places:
        if text.isdigit() and place.stable_id == int(text):
            return place
    names = list(dict.fromkeys(place.label for place in places))
    listed = ", ".join(repr(name) for name in names[:_LISTED]) or "none has a name yet"
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    raise UsageError(f"no region is called {wanted!r}; expected one of: {listed}{more}")


def _rows(value: object) -> list[Mapping[str, Any]]:
    rows = value if isinstance(value, list) else []
    return [row if isinstance(row, Mapping) else {} for row in rows]


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value)


def _triple(value: object) -> tuple[float, float, float] | None:
    numbers = [_number(one) for one in value] if isinstance(value, list) else []
    if len(numbers) != 3:
        return None
    x, y, z = numbers
    return None if x is None or y is None or z is None else (x, y, z)
