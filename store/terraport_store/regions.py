"""Names of a scene's regions: their stable ids and what they are called.

A region's number in payloads belongs to one version; its stable id is the same in every version,
and a user's label belongs to the stable id. Rules in ``spec/scene-format.md``, section
"regions.json".

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from terraport_payload.types import UInt32
from terraport_store.errors import DamagedSceneError
from terraport_store.labels import MAX_LABEL_LENGTH, MAX_STABLE_ID
from terraport_store.layout import REGIONS

__all__ = ["RegionNames"]


@dataclass(frozen=True, slots=True, eq=False)
class RegionNames:
    """Stable ids and labels of the regions of one version, and the labels that users set."""

    stable_ids: UInt32 | None = None
    """(R,) by region; None where regions.json gives none."""
    next_stable_id: int = 0
    """Lowest number that no region of the scene ever had; 0 without stable ids."""
    given: Mapping[int, str] = field(default_factory=dict)
    """Label that the build itself gives, by region."""
    labels: Mapping[int, str] = field(default_factory=dict)
    """Label that users set, by stable id; may name numbers that no region has."""

    @classmethod
    def of(cls, document: Mapping[str, Any], *, file: str = REGIONS) -> Self:
        """Read the names in a regions.json.

        Parameters
        ----------
        document : mapping
            The parsed file.
        file : str, optional
            How errors call it.

        Returns
        -------
        RegionNames
            Without users' labels.

        Raises
        ------
        DamagedSceneError
            When the list is none, or stable ids are there but incomplete, out of range, repeated or
            not below ``next_stable_id``.
        """
        rows = document.get("regions")
        if not isinstance(rows, list):
            raise DamagedSceneError(file, f"regions are a {type(rows).__name__}, expected a list")
        given = {
            region: row["label"][:MAX_LABEL_LENGTH]
            for region, row in enumerate(rows)
            if isinstance(row, dict) and isinstance(row.get("label"), str) and row["label"]
        }
        first_free = document.get("next_stable_id")
        numbers = [row.get("stable_id") if isinstance(row, dict) else None for row in rows]
        if first_free is None and all(number is None for number in numbers):
            return cls(given=given)
        if type(first_free) is not int or not 0 <= first_free <= MAX_STABLE_ID + 1:
            raise DamagedSceneError(
                file, f"next_stable_id {first_free!r}, expected 0 to {MAX_STABLE_ID + 1}"
            )
        seen: dict[int, int] = {}
        for region, number in enumerate(numbers):
            if type(number) is not int or not 0 <= number < first_free:
                raise DamagedSceneError(
                    file, f"region {region}: stable_id {number!r}, expected 0 to {first_free - 1}"
                )
            if number in seen:
                raise DamagedSceneError(
                    file,
                    f"region {region}: stable_id {number} as region {seen[number]}, expected once",
                )
            seen[number] = region
        return cls(np.array(numbers, dtype=np.uint32), first_free, given)

    def with_labels(self, labels: Mapping[int, str]) -> Self:
        """Return the same names with other labels of users."""
        return replace(self, labels=labels)

    def stable_id(self, region: int) -> int | None:
        """Stable id of a region; None for one that has none or is not there."""
        if self.stable_ids is None or not 0 <= region < len(self.stable_ids):
            return None
        return int(self.stable_ids[region])

    def label(self, region: int) -> str | None:
        """Label of a region: the user's, else the build's, else None."""
        number = self.stable_id(region)
        label = None if number is None else self.labels.get(number)
        return self.given.get(region) if label is None else label

    def without_region(self) -> dict[int, str]:
        """Users' labels whose stable id no region of this version has, ascending."""
        known = set() if self.stable_ids is None else set(self.stable_ids.tolist())
        return {n: label for n, label in sorted(self.labels.items()) if n not in known}
