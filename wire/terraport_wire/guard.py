"""Structure checks before a message is decoded: depth, sizes and ends, without building anything.

A few bytes of msgpack can promise 2^32 items; a decoder that believes them reserves memory for
them.  :func:`check_msgpack` walks the tokens of one message first, so that whatever reaches the
decoder is exactly one complete value within the limits.  :func:`leading_type` tells the type of a
message without a walk, so that one of an unknown type need not be walked at all.
"""

from __future__ import annotations

from .errors import MalformedError
from .limits import MAX_CONTAINER_ITEMS, MAX_DEPTH

__all__ = ["check_msgpack", "leading_type"]

# Tokens with a fixed number of bytes after the first: nil, booleans, floats, integers.
_FIXED = {0xC0: 0, 0xC2: 0, 0xC3: 0, 0xCA: 4, 0xCB: 8}
_FIXED |= {0xCC: 1, 0xCD: 2, 0xCE: 4, 0xCF: 8, 0xD0: 1, 0xD1: 2, 0xD2: 4, 0xD3: 8}
# Tokens with a length field of so many bytes, then as many bytes of content.
_SIZED = {0xC4: 1, 0xC5: 2, 0xC6: 4, 0xD9: 1, 0xDA: 2, 0xDB: 4}
# Containers with a count field: (bytes of the count, values per item).
_COUNTED = {0xDC: (2, 1), 0xDD: (4, 1), 0xDE: (2, 2), 0xDF: (4, 2)}

_TYPE_KEY = b"\xa4type"


def check_msgpack(data: bytes, *, max_values: int | None = None) -> None:
    """Check that `data` is one whole msgpack value within depth and item limits.

    Cost is one step per value, a key being one: packed ids and tables are one value each.

    Parameters
    ----------
    data : bytes
        One message.
    max_values : int, optional
        Most values in it, itself counted; the walk ends there.

    Raises
    ------
    MalformedError
        With the offset of the token that is cut off, too large, too deep, one too many, unused
        (0xC1), an extension, or after the end.
    """
    # Invariant: `due` values are still to come in the innermost open container, `open_values` in
    # those around it; `position` never moves back, so the walk ends within len(data) steps.
    position = 0
    left = len(data) if max_values is None else max_values  # a value takes at least one byte
    open_values: list[int] = []  # values still due in each open container, outermost first
    due = 1
    while due:
        start = position
        if position >= len(data):
            raise MalformedError("got the end of the message, expected a value", offset=start)
        if not left:
            text = f"got more than {max_values} values, expected fewer"
            raise MalformedError(text, offset=start)
        left -= 1
        # (1) One token: step over a scalar's bytes, or learn how many values a container holds.
        token = data[position]
        position += 1
        due -= 1
        items = -1  # no container
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
        # (2) Go into a container, or out of all those that this value completes.
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


def leading_type(data: bytes) -> str | None:
    """Return the message type of a msgpack map whose first key is ``type``, else None.

    Nothing behind it is looked at.

    Examples
    --------
    >>> leading_type(bytes.fromhex("82 a474797065 a3627965 c1"))
    'bye'
    """
    if not data or not (0x81 <= data[0] <= 0x8F or data[0] in {0xDE, 0xDF}):
        return None
    position = 1 + _COUNTED.get(data[0], (0, 0))[0]
    if data[position : position + len(_TYPE_KEY)] != _TYPE_KEY:
        return None
    position += len(_TYPE_KEY)
    token = data[position] if position < len(data) else 0
    if 0xA0 <= token <= 0xBF:
        start, length = position + 1, token & 0x1F
    elif token in {0xD9, 0xDA, 0xDB}:
        start = position + 1 + _SIZED[token]
        length = int.from_bytes(data[position + 1 : start], "big")
    else:
        return None
    if start + length > len(data):
        return None
    try:
        return data[start : start + length].decode("utf-8")
    except UnicodeDecodeError:
        return None


def _count(data: bytes, position: int, width: int, start: int) -> tuple[int, int]:
    end = position + width
    if end > len(data):
        raise MalformedError(
            f"got {len(data) - start} bytes, expected a length of {width} bytes", offset=start
        )
    return int.from_bytes(data[position:end], "big"), end
