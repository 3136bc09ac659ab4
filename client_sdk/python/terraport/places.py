"""Regions with a name as places to go to, and the coarser pieces of ground that they are part of.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from terraport.errors import UsageError

__all__ = ["CoarserPiece", "Place", "coarser_pieces", "find_place", "places_of"]

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
    rows = _rows(document.get("regions"))
    places = []
    for number, label in _names(rows, labels).items():
        row = rows[number]
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


@dataclass(frozen=True, slots=True)
class CoarserPiece:
    """What a region is united to at some cost."""

    cost: float
    """1 is what two regions cost no more than; higher is coarser."""
    regions: tuple[int, ...]
    """Numbers in this version, ascending."""
    area_m2: float
    """Of all of them, as far as it is known."""
    label: str | None
    """What most of its named ground is called; None where none of it has a name."""


def coarser_pieces(
    document: Mapping[str, Any], labels: Mapping[str, Any], region: int
) -> tuple[CoarserPiece, ...]:
    """Read the pieces that a region is part of, finest first.

    Parameters
    ----------
    document : mapping
        Contents of regions.json.
    labels : mapping
        Contents of labels.json.
    region : int
        Its number in this version, as picks have it.

    Returns
    -------
    tuple of CoarserPiece
        One for each cost at which more is united; each holds those before. Empty where the scene
        says nothing of it, and for a region that is not there.

    Examples
    --------
    >>> regions = [{"area_m2": 2.0, "label": "field"}, {"area_m2": 3.0}, {"area_m2": 5.0}]
    >>> document = {"regions": regions, "unions": [[0, 1, 1.5], [2, 3, 4.0]]}
    >>> [(p.cost, p.regions, p.area_m2, p.label) for p in coarser_pieces(document, {}, 1)]
    [(1.5, (0, 1), 5.0, 'field'), (4.0, (0, 1, 2), 10.0, 'field')]
    """
    rows = document.get("regions")
    unions = document.get("unions")
    if not isinstance(rows, list) or not isinstance(unions, list) or not 0 <= region < len(rows):
        return ()
    # A piece is held by its members; unions name pieces before them alone.
    members: list[tuple[int, ...]] = [(number,) for number in range(len(rows))]
    found: dict[float, tuple[int, ...]] = {}
    at = region
    for union in unions:
        if not _is_union(union, len(members)):
            break  # what follows would name pieces that are not there
        one, other, cost = union
        members.append((*members[one], *members[other]))
        members[one] = members[other] = ()
        if at in (one, other):
            at = len(members) - 1
            found[float(cost)] = members[at]
    named = _names(_rows(rows), labels)
    return tuple(_piece(rows, named, cost, held) for cost, held in found.items())


def _piece(
    rows: list[Any], named: Mapping[int, str], cost: float, held: tuple[int, ...]
) -> CoarserPiece:
    held_rows = [(number, _rows(rows)[number]) for number in held]
    area = {number: _number(row.get("area_m2")) or 0.0 for number, row in held_rows}
    of_name: dict[str, float] = {}
    for number in held:
        if number in named:
            of_name[named[number]] = of_name.get(named[number], 0.0) + area[number]
    label = max(of_name, key=lambda name: (of_name[name], name)) if of_name else None
    return CoarserPiece(cost, tuple(sorted(held)), sum(area.values()), label)


def _is_union(union: object, pieces: int) -> bool:
    if not isinstance(union, list) or len(union) != 3:
        return False
    one, other, cost = union
    numbers = all(isinstance(end, int) and 0 <= end < pieces for end in (one, other))
    return numbers and one != other and isinstance(cost, int | float)


def _names(rows: Sequence[Mapping[str, Any]], labels: Mapping[str, Any]) -> dict[int, str]:
    """Return what each region is called, by its number: the newest label, else the scene's own."""
    given = {row.get("stable_id"): row.get("label") for row in _rows(labels.get("labels"))}
    named = {}
    for number, row in enumerate(rows):
        label = given.get(row.get("stable_id")) or row.get("label")
        if isinstance(label, str) and label:
            named[number] = label
    return named


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
