"""Where one WebSocket frame of a client ends, so that bytes can be taken a frame at a time.

PURE: no I/O, no clock.
"""

from __future__ import annotations

__all__ = ["FrameCutter"]


class FrameCutter:
    """Bytes that came and were not taken yet, handed out in pieces that end where frames end.

    The library parses whatever it is given at once. One read of a socket may hold 40,000 frames
    without content, which take it a quarter of a second; cut, they can be taken a few at a time,
    and between them it is everybody else's turn. Nothing is checked here: what breaks the rules is
    handed out like everything else, and refused by the parser.

    Examples
    --------
    >>> cutter = FrameCutter()
    >>> cutter.add(bytes.fromhex("8982 00000000 4142 8180 0000"))
    >>> [cutter.next().hex(), cutter.next().hex(), len(cutter)]
    ['8982000000004142', '', 4]
    """

    __slots__ = ("_at", "_data", "_left")

    def __init__(self) -> None:
        self._data = b""
        self._at = 0
        self._left = 0
        """Bytes that are to come of the frame which was handed out in part."""

    def __len__(self) -> int:
        """Return how many bytes wait."""
        return len(self._data) - self._at

    def add(self, data: bytes) -> None:
        """Put bytes behind those that wait."""
        self._data = self._data[self._at :] + data if len(self) else data
        self._at = 0

    def clear(self) -> None:
        """Drop what waits."""
        self._data, self._at = b"", 0

    @property
    def frame_bytes(self) -> int:
        """How long the next frame says that it is, or the rest of one; 0 while that is unknown."""
        return self._left or _frame_bytes(self._data, self._at)

    @property
    def between(self) -> bool:
        """Whether what was handed out ended with a frame."""
        return not self._left

    def next(self) -> bytes:
        """Return one frame, or as much of it as there is; nothing while its length is unknown."""
        data, at = self._data, self._at
        if not self._left:
            self._left = _frame_bytes(data, at)
            if not self._left:
                return b""
        end = min(len(data), at + self._left)
        self._left -= end - at
        if end == len(data):
            self.clear()
        else:
            self._at = end
        return data if end - at == len(data) else data[at:end]


def _frame_bytes(data: bytes, at: int) -> int:
    """Return the length of the frame that begins there, 0 where its header is not whole."""
    have = len(data) - at
    if have < 2:
        return 0
    second = data[at + 1]
    length, header = second & 0x7F, 6 if second & 0x80 else 2
    if length >= 126:
        width = 2 if length == 126 else 8
        header += width
        length = int.from_bytes(data[at + 2 : at + 2 + width], "big")
    return header + length if have >= header else 0
