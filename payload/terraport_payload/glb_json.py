"""Values out of a glTF document, each checked for what it is before it is used.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Any

from terraport_payload.errors import PayloadError

__all__ = ["only", "pick", "typed"]


def typed(value: object, kind: type[Any], label: str) -> Any:
    """Return *value* if it is of *kind*.

    Raises
    ------
    PayloadError
        Naming it by *label*.
    """
    if not isinstance(value, kind):
        raise PayloadError(f"{label} is {type(value).__name__}, expected {kind.__name__}")
    return value


def only(owner: dict[str, Any], key: str) -> object:
    """Return the one entry of the list under *key*.

    Raises
    ------
    PayloadError
        When there is no list, or it has another length.
    """
    values = typed(owner.get(key), list, key)
    if len(values) != 1:
        raise PayloadError(f"{len(values)} {key}, expected 1")
    return values[0]


def pick(values: list[Any], number: object, noun: str, label: str = "") -> object:
    """Return entry *number* of a list.

    Raises
    ------
    PayloadError
        When it is no whole number, or there is no such entry; *noun* and *label* name it. They come
        apart since putting text together costs more than the check, which rarely fails.
    """
    if type(number) is not int or not 0 <= number < len(values):  # a bool is an int to isinstance
        name = f"{noun} {label}" if label else noun
        raise PayloadError(f"{name} is {number!r}, expected 0 to {len(values) - 1}")
    return values[number]
