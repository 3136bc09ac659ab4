"""Structure checks before a message is decoded: depth, sizes and ends, without building anything.

A few bytes of msgpack can promise 2^32 items; a decoder that believes them reserves memory for
them.  :func:`check_msgpack` walks the tokens of one message first, so that whatever reaches the
decoder is exactly one complete value within the limits.
"""

from __future__ import annotations

from typing import Any

from .errors import MalformedError
from .limits import MAX_CONTAINER_ITEMS, MAX_DEPTH

__all__ = ["check_depth", "check_msgpack"]

# Tokens with a fixed number of bytes after the first: nil, booleans, floats, integers.
_FIXED = {0xC0: 0, 0xC2: 0, 0xC3: 0, 0xCA: 4, 0xCB: 8}
_FIXED |= {0xCC: 1, 0xCD: 2, 0xCE: 4, 0xCF: 8, 0xD0: 1, 0xD1: 2, 0xD2: 4, 0xD3: 8}
# Tokens with a length field of so many bytes, then as many bytes of content.
_SIZED = {0xC4: 1, 0xC5: 2, 0xC6: 4, 0xD9: 1, 0xDA: 2, 0xDB: 4}
# Containers with a count field: (bytes of the count, values per item).
_COUNTED = {0xDC: (2, 1), 0xDD: (4, 1), 0xDE: (2, 2), 0xDF: (4, 2)}

_NESTED = (dict, list)


def check_msgpack(data: bytes) -> None:
    """Check that `data` is one whole msgpack value within depth and item limits.

    Cost is one step per token: packed ids and tables are one token each.

    Raises
    ------
    MalformedError
        With the offset of the token that is cut off, too large, too deep, unused (0xC1), an
        extension, or after the end.
    """
    position = 0
    open_values: list[int] = []  # values still due in each open container, outermost first
    due = 1
    while due:
        start = position
        if position >= len(data):
            raise MalformedError("got the end of the message, expected a value", offset=start)
        token = data[position]
        position += 1
        due -= 1
        items = -1
        if token <= 0x7F or token >= 0xE0:
            pass
        elif token <= 0x8F:
            items = 2 * (token & 0x0F)
        elif token <= 0x9F:
            items = token & 0x0F
        elif token <= 0xBF:
            position += token & 0x1F
        elif token in _FIXED:
            position += _FIXED[token]
        elif token in _SIZED:
            length, position = _count(data, position, _SIZED[token], start)
            position += length
        elif token in _COUNTED:
            width, per_item = _COUNTED[token]
            count, position = _count(data, position, width, start)
            if count > MAX_CONTAINER_ITEMS:
                text = f"got {count} items, expected at most {MAX_CONTAINER_ITEMS}"
                raise MalformedError(text, offset=start)
            items = count * per_item
        else:
            raise MalformedError(
                f"got msgpack token 0x{token:02x}, which no message uses", offset=start
            )
        if position > len(data):
            text = f"got {len(data) - start} bytes, expected {position - start} of a value"
            raise MalformedError(text, offset=start)
        if items >= 0:
            if len(open_values) + 1 > MAX_DEPTH:
                raise MalformedError(f"got nesting beyond {MAX_DEPTH} levels", offset=start)
            open_values.append(due)
            due = items
        while due == 0 and open_values:
            due = open_values.pop()
    if position != len(data):
        text = f"got {len(data) - position} bytes after the message, expected none"
        raise MalformedError(text, offset=position)


def check_depth(value: Any) -> None:
    """Check that a decoded JSON value is nested at most `MAX_DEPTH` deep.

    Raises
    ------
    MalformedError
        If it is nested deeper.
    """
    # json.loads makes plain dicts and lists alone; a held table has 32,768 of them.
    level = [value] if type(value) in _NESTED else []
    for _ in range(MAX_DEPTH):
        level = [
            inner
            for outer in level
            for inner in (outer.values() if type(outer) is dict else outer)
            if type(inner) in _NESTED
        ]
        if not level:
            return
    raise MalformedError(f"got nesting beyond {MAX_DEPTH} levels")


def _count(data: bytes, position: int, width: int, start: int) -> tuple[int, int]:
    end = position + width
    if end > len(data):
        raise MalformedError(
            f"got {len(data) - start} bytes, expected a length of {width} bytes", offset=start
        )
    return int.from_bytes(data[position:end], "big"), end
