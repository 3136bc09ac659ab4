"""A survey's text as pyarrow's CSV reader wants it, a block at a time."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from typing_extensions import Buffer  # in collections.abc from Python 3.12

__all__ = ["CleanText"]

BLOCK_BYTES: Final = 1 << 22
"""Text that is normalised at once."""

_COMMENT: Final = re.compile(rb"^[ \t]*(?:#|//)[^\n]*\n?", re.MULTILINE)
_BLANKS: Final = re.compile(rb"[ \t]+")
_EDGES: Final = re.compile(rb"^[ \t\r]+|[ \t\r]+$", re.MULTILINE)


class CleanText(io.RawIOBase):
    """The file without comments, head lines and surplus blanks, as a stream for pyarrow.

    Parameters
    ----------
    file : binary file
        At its beginning.
    blanks : bool
        Values are parted by any run of blanks and tabs.
    skip_lines : int
        Lines before the first row, comments not counted.
    advance : callable
        Told of bytes read since last time.
    """

    def __init__(
        self,
        file: io.BufferedReader,
        *,
        blanks: bool,
        skip_lines: int,
        advance: Callable[[int], None],
    ) -> None:
        super().__init__()
        self._file = file
        self._blanks = blanks
        self._advance = advance
        self._skip = skip_lines
        self._first = True
        self._ready = b""
        self._at = 0

    def readable(self) -> bool:
        """Return True: :class:`io.RawIOBase` asks before it reads."""
        return True

    def readinto(self, buffer: Buffer, /) -> int:
        """Fill a buffer, or some of it; 0 at the end."""
        view = memoryview(buffer).cast("B")
        while self._at == len(self._ready):
            block = self._file.read(BLOCK_BYTES)
            if not block:
                return 0
            block += self._file.readline()
            self._advance(len(block))
            self._ready, self._at = self._clean(block), 0
        chunk = self._ready[self._at : self._at + len(view)]
        view[: len(chunk)] = chunk
        self._at += len(chunk)
        return len(chunk)

    def _clean(self, block: bytes) -> bytes:
        if self._first:
            block, self._first = block.removeprefix(b"\xef\xbb\xbf"), False
        if b"#" in block or b"//" in block:
            block = _COMMENT.sub(b"", block)
        if self._blanks:
            block = _BLANKS.sub(b" ", block)
        block = _EDGES.sub(b"", block)
        while self._skip and block:
            line, _, block = block.partition(b"\n")
            self._skip -= bool(line.strip())
        return block
