"""Which columns of a survey are its colours, and how their values become 0..255.

PURE.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, Literal

import numpy as np

from terraport_payload.types import AnyArray, UInt8

__all__ = ["Depth", "apply_depth", "choose_depth", "find_colours"]

Depth = Literal["unit", "eight", "sixteen"]
"""How colour values become 0..255: from 0..1, from 0..255, or from 0..65,535."""

_COLOUR_NAMES: Final = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
)
"""Field names that mean colour, compared in lower case."""

_MAX_EIGHT_BIT: Final = 255


def choose_depth(
    low: float, high: float, dtype: np.dtype[Any], *, where: str
) -> tuple[Depth | None, tuple[str, ...]]:
    """Choose by a survey's lowest and highest colour value how its colours become 0..255.

    The rules: floats within 0..1 are scaled by 255; whole numbers within 0..255 are taken as they
    are; larger ones up to 65,535 lose their low byte (which is right both for files that multiply
    by 256 and for those that multiply by 257); black everywhere means "no colour"; anything else
    is no colour either.

    Parameters
    ----------
    low, high : float
        Of all finite values.
    dtype : numpy.dtype
        That the file has them in.
    where : str
        Names the fields in warnings, for example ``"red, green, blue"``.

    Returns
    -------
    rule : {"unit", "eight", "sixteen"} or None
        For :func:`apply_depth`; None when they are no colours.
    warnings : tuple of str
    """
    if low < 0.0 or high > np.iinfo(np.uint16).max:
        warning = f"The fields {where} hold values from {low:g} to {high:g}, which are no colours."
        return None, (warning,)
    if high == 0.0:
        return None, (f"The fields {where} are 0 in every point.",)
    if dtype.kind == "f" and high <= 1.0:
        return "unit", ()
    return ("eight" if high <= _MAX_EIGHT_BIT else "sixteen"), ()


def apply_depth(colours: AnyArray, rule: Depth) -> UInt8:
    """Bring finite colours to 0..255 by the rule that the whole survey asks for."""
    if rule == "unit":
        unit: UInt8 = np.rint(colours * _MAX_EIGHT_BIT).astype(np.uint8)
        return unit
    if rule == "eight":
        return colours.astype(np.uint8)
    return (colours.astype(np.uint16) >> 8).astype(np.uint8)


def find_colours(names: Sequence[str]) -> tuple[str, str, str] | None:
    """Return the three names, as spelt in `names`, that hold red, green and blue."""
    lower = {name.lower(): name for name in reversed(names)}
    for triple in _COLOUR_NAMES:
        if all(name in lower for name in triple):
            return lower[triple[0]], lower[triple[1]], lower[triple[2]]
    return None
