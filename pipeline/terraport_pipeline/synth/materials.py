"""What a synthetic point can be made of. The numbers are the labels of the truth file."""

from __future__ import annotations

from enum import IntEnum, unique
from typing import Final

__all__ = ["PILE_MATERIALS", "Material"]


@unique
class Material(IntEnum):
    """Label of a point; the value is stored, the lower-case name is written beside it."""

    ROCK_FACE = 0
    BENCH = 1
    ROAD = 2
    WATER = 3
    LIMESTONE_PILE = 4
    ORE_PILE = 5
    SAND_PILE = 6
    OVERBURDEN_PILE = 7
    GRASSLAND = 8
    TREE = 9
    BUSH = 10
    BOULDER = 11
    OUTLIER = 255
    """Not a material: the point belongs to no surface."""


PILE_MATERIALS: Final = (
    Material.LIMESTONE_PILE,
    Material.ORE_PILE,
    Material.SAND_PILE,
    Material.OVERBURDEN_PILE,
)
"""Pile number n is made of entry n modulo 4."""
