"""Arrays of tiles: by name, and one list per tile as one array with its starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from terraport_payload.types import AnyArray

__all__ = ["TileArrays", "listed_by_tile", "split_by_tile"]

TileArrays = Mapping[str, AnyArray]
"""What is kept of a tile, by name."""


def listed_by_tile(name: str, per_tile: Sequence[AnyArray]) -> dict[str, AnyArray]:
    """Make one array of one list per tile, and the array of its starts."""
    return {
        name: np.concatenate(per_tile),
        f"{name}-starts": np.cumsum([0, *(len(rows) for rows in per_tile)]),
    }


def split_by_tile(arrays: TileArrays, name: str) -> tuple[Any, ...]:
    """Give every tile its list back."""
    return tuple(np.split(np.array(arrays[name]), arrays[f"{name}-starts"][1:-1]))
