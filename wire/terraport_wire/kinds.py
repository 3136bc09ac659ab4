"""Kinds of fields: one object knows a field's check and its wire form.

A message class names the kind of each field in ``Annotated``.

Every check raises :class:`Refused` with text "got ACTUAL, expected EXPECTED".
"""

# ruff: noqa: D102 - the interface Kind documents these methods
from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .limits import MAX_COORDINATE_M, MAX_INTEGER

__all__ = [
    "Binary",
    "Choice",
    "Flag",
    "Integer",
    "Kind",
    "Number",
    "NumberMap",
    "Position",
    "Refused",
    "Rows",
    "Text",
    "clip",
]

_SHOWN_CHARACTERS = 48


class Refused(Exception):  # noqa: N818 - never leaves the package; callers see FieldError
    """A value that its kind does not allow; ``path`` names the place below the field."""

    def __init__(self, text: str, path: str = "") -> None:
        super().__init__(text)
        self.text = text
        self.path = path


def clip(value: object) -> str:
    """Show a value in an error text, never more than a few dozen characters of it."""
    if isinstance(value, (str, bytes, bytearray)):
        shown = repr(value[:_SHOWN_CHARACTERS])
        return shown if len(value) <= _SHOWN_CHARACTERS else f"{shown}... ({len(value)} long)"
    if isinstance(value, (list, tuple, np.ndarray)):
        if len(value) > 4 or any(isinstance(item, (list, tuple, dict)) for item in value):
            return f"{type(value).__name__} of {len(value)}"
        return "[" + ", ".join(clip(item) for item in value) + "]"
    if isinstance(value, dict):
        return f"map of {len(value)}"
    if isinstance(value, int) and abs(value) > 10**20:
        return "integer beyond 10^20"
    if value is None:
        return "nothing"
    return str(value)[:_SHOWN_CHARACTERS]


class Kind(Protocol):
    """What a field holds."""

    def check(self, value: Any) -> Any:
        """Return `value` in its canonical Python form; raise `Refused` if it is not allowed."""

    def to_wire(self, value: Any) -> Any:
        """Return what is given to msgpack for a checked value."""

    def from_wire(self, raw: Any) -> Any:
        """Return the Python value for what msgpack gave; it is not checked."""

    def describe(self) -> str:
        """Return the type for error texts."""


class _Plain:
    """A kind whose wire form is the value itself."""

    def to_wire(self, value: Any) -> Any:
        return value

    def from_wire(self, raw: Any) -> Any:
        return raw


class Integer(_Plain):
    """An integer in ``[low, high]``; floats and booleans are refused."""

    def __init__(self, low: int = 0, high: int = MAX_INTEGER) -> None:
        self.low = low
        self.high = high

    def check(self, value: Any) -> int:
        if isinstance(value, np.integer):
            value = int(value)
        if type(value) is not int or not self.low <= value <= self.high:
            raise Refused(f"got {clip(value)}, expected an integer from {self.low} to {self.high}")
        return value

    def describe(self) -> str:
        names = {2**32 - 1: "2^32-1", MAX_INTEGER: "2^53-1"}
        return f"integer {self.low}..{names.get(self.high, str(self.high))}"


class Number(_Plain):
    """A finite number in ``[low, high]``, or ``(low, high]`` where `low_excluded`."""

    def __init__(self, low: float, high: float, *, low_excluded: bool = False) -> None:
        self.low = low
        self.high = high
        self.low_excluded = low_excluded

    def check(self, value: Any) -> float:
        number = _finite(value)
        if number is None or not self._inside(number):
            raise Refused(f"got {clip(value)}, expected a number {self._range()}")
        return number

    def _inside(self, number: float) -> bool:
        above = number > self.low if self.low_excluded else number >= self.low
        return above and number <= self.high

    def _range(self) -> str:
        opening = "above" if self.low_excluded else "from"
        return f"{opening} {self.low:g} to {self.high:.15g}"

    def describe(self) -> str:
        return f"number {'(' if self.low_excluded else '['}{self.low:g}, {self.high:.15g}]"


class Flag(_Plain):
    """A boolean."""

    def check(self, value: Any) -> bool:
        if type(value) is not bool:
            raise Refused(f"got {clip(value)}, expected true or false")
        return value

    def describe(self) -> str:
        return "boolean"


class Text(_Plain):
    """A string of at most `longest` characters, at least `shortest`; `pattern` in full, if any.

    Strings count in Unicode code points; lone surrogates are refused because UTF-8 has none.
    """

    def __init__(self, longest: int, *, shortest: int = 0, pattern: str | None = None) -> None:
        self.longest = longest
        self.shortest = shortest
        self.pattern = pattern

    def check(self, value: Any) -> str:
        if not isinstance(value, str) or not self.shortest <= len(value) <= self.longest:
            raise Refused(
                f"got {clip(value)}, expected text of {self.shortest} to {self.longest} characters"
            )
        if any("\ud800" <= character <= "\udfff" for character in value):
            raise Refused("got text with a lone surrogate, expected Unicode text")
        if self.pattern is not None and not re.fullmatch(self.pattern, value):
            raise Refused(f"got {clip(value)}, expected text that matches {self.pattern}")
        return str(value)

    def describe(self) -> str:
        shape = f" `{self.pattern}`" if self.pattern is not None else ""
        return f"text {self.shortest}..{self.longest}{shape}"


class Choice(_Plain):
    """One of a fixed set of strings."""

    def __init__(self, *options: str) -> None:
        self.options = options

    def check(self, value: Any) -> str:
        if not isinstance(value, str) or value not in self.options:
            raise Refused(f"got {clip(value)}, expected one of {', '.join(self.options)}")
        return str(value)

    def describe(self) -> str:
        return "one of " + ", ".join(f"`{option}`" for option in self.options)


class Position(_Plain):
    """Three finite numbers, each at most `bound` in size; ``nonzero`` refuses (0, 0, 0)."""

    def __init__(self, bound: float = MAX_COORDINATE_M, *, nonzero: bool = False) -> None:
        self.bound = bound
        self.nonzero = nonzero

    def check(self, value: Any) -> tuple[float, float, float]:
        if not isinstance(value, (list, tuple, np.ndarray)) or len(value) != 3:
            raise Refused(f"got {clip(value)}, expected three numbers")
        numbers = [_finite(item) for item in value]
        x, y, z = numbers
        if x is None or y is None or z is None or max(abs(x), abs(y), abs(z)) > self.bound:
            raise Refused(
                f"got {clip(value)}, expected three finite numbers of size at most "
                f"{self.bound:.15g}"
            )
        if self.nonzero and x == y == z == 0.0:
            raise Refused("got (0, 0, 0), expected a direction")
        return (x, y, z)

    def to_wire(self, value: Any) -> Any:
        return list(value)

    def describe(self) -> str:
        return f"3 numbers, size <= {self.bound:.15g}" + (", not all 0" if self.nonzero else "")


class NumberMap(_Plain):
    """A map from names (1..128 characters) to finite numbers, at most `most` of them."""

    _name = Text(128, shortest=1)

    def __init__(self, most: int) -> None:
        self.most = most

    def check(self, value: Any) -> dict[str, float]:
        if not isinstance(value, Mapping) or len(value) > self.most:
            raise Refused(f"got {clip(value)}, expected a map of at most {self.most} numbers")
        checked: dict[str, float] = {}
        for name, item in value.items():
            name = self._name.check(name)
            number = _finite(item)
            if number is None:
                raise Refused(f"got {clip(item)}, expected a finite number", name)
            checked[name] = number
        return checked

    def describe(self) -> str:
        return f"map of text 1..128 to number, at most {self.most}"


class Rows:
    """Packed rows of one dtype, at most `most`: a read-only array in Python."""

    def __init__(self, dtype: np.dtype[Any], most: int) -> None:
        self.dtype = dtype
        self.most = most

    def check(self, value: Any) -> NDArray[Any]:
        rows = np.ascontiguousarray(value, dtype=self.dtype)
        if rows.ndim != 1 or len(rows) > self.most:
            raise Refused(f"got shape {rows.shape}, expected at most {self.most} rows")
        if rows.flags.writeable:
            rows = rows.copy()
            rows.setflags(write=False)
        return rows

    def to_wire(self, value: Any) -> bytes:
        data: bytes = value.tobytes()
        return data

    def from_wire(self, raw: Any) -> NDArray[Any]:
        size = self.dtype.itemsize
        if not isinstance(raw, bytes) or len(raw) % size or len(raw) > self.most * size:
            raise Refused(f"got {clip(raw)}, expected {self.describe()}")
        return np.frombuffer(raw, dtype=self.dtype)

    def describe(self) -> str:
        return f"binary of at most {self.most} rows of {self.dtype.itemsize} bytes"


class Binary(_Plain):
    """Bytes, at most `most`."""

    def __init__(self, most: int) -> None:
        self.most = most

    def check(self, value: Any) -> bytes:
        if not isinstance(value, bytes) or len(value) > self.most:
            raise Refused(f"got {clip(value)}, expected {self.describe()}")
        return value

    def describe(self) -> str:
        return f"binary of at most {self.most} bytes"


def _finite(value: Any) -> float | None:
    if isinstance(value, (np.floating, np.integer)):
        value = value.item()
    if type(value) is not float and type(value) is not int:
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
