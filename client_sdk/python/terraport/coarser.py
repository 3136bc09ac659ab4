"""Coarser pieces of ground that a region is part of: the field's farm, and its valley."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["CoarserPiece", "coarser_pieces"]


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
    named = _names(rows, labels)
    return tuple(_piece(rows, named, cost, held) for cost, held in found.items())


def _piece(
    rows: list[Any], named: Mapping[int, str], cost: float, held: tuple[int, ...]
) -> CoarserPiece:
    area = {number: _area(rows[number]) for number in held}
    of_name: dict[str, float] = {}
    for number in held:
        if number in named:
            of_name[named[number]] = of_name.get(named[number], 0.0) + area[number]
    label = max(of_name, key=lambda name: (of_name[name], name)) if of_name else None
    return CoarserPiece(cost, tuple(sorted(held)), sum(area.values()), label)


def _names(rows: list[Any], labels: Mapping[str, Any]) -> dict[int, str]:
    given = labels.get("labels")
    by_id = {
        row.get("stable_id"): row.get("label")
        for row in (given if isinstance(given, list) else [])
        if isinstance(row, Mapping)
    }
    named = {}
    for number, row in enumerate(rows):
        if isinstance(row, Mapping):
            label = by_id.get(row.get("stable_id")) or row.get("label")
            if isinstance(label, str) and label:
                named[number] = label
    return named


def _is_union(union: object, pieces: int) -> bool:
    if not isinstance(union, list) or len(union) != 3:
        return False
    one, other, cost = union
    numbers = all(isinstance(end, int) and 0 <= end < pieces for end in (one, other))
    return numbers and one != other and isinstance(cost, int | float)


def _area(row: Any) -> float:
    value = row.get("area_m2") if isinstance(row, Mapping) else None
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else 0.0
