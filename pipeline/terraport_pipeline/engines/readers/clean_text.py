"""A survey's text as pyarrow's CSV reader wants it, a block at a time."""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from terraport_pipeline.errors import ReadError

if TYPE_CHECKING:
    from typing_extensions import Buffer  # in collections.abc from Python 3.12

__all__ = ["CleanText", "text_encoding"]

BLOCK_BYTES: Final = 1 << 22
"""Text that is normalised at once."""

_COMMENT: Final = re.compile(rb"^[ \t]*(?:#|//)[^\n]*\n?", re.MULTILINE)
_BLANKS: Final = re.compile(rb"[ \t]+")
_EDGES: Final = re.compile(rb"^[ \t\r]+|[ \t\r]+$", re.MULTILINE)


_TAIL_OF_TABS: Final = re.compile(rb"^[ \r]+|[ \r]+$", re.MULTILINE)
"""Blanks to strip if tabs are delimiters; a tab at the end of a line precedes an empty value."""

_COUNT: Final = re.compile(rb"^[0-9]+(?:\n|\Z)", re.MULTILINE)

_UTF_16: Final = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


def text_encoding(path: Path, head: bytes) -> str:
    """Return a text's encoding by its first bytes: ``utf-8``, ``utf-16-le`` or ``utf-16-be``.

    Raises
    ------
    ReadError
        The text has zero bytes and no byte order mark of UTF-16.
    """
    if head[:2] in _UTF_16 and head[2:4] != b"\0\0":
        return _UTF_16[head[:2]]
    if b"\0" not in head:
        return "utf-8"
    zeros = {"utf-16-le": head[1:64:2], "utf-16-be": head[:64:2]}
    is_wide = head.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE))
    if is_wide or any(len(half) > 1 and not half.strip(b"\0") for half in zeros.values()):
        raise ReadError(
            path,
            "this is UTF-16 without the mark that says so, or UTF-32",
            "save it as UTF-8",
            "byte 0",
        )
    raise ReadError(
        path,
        "this is no text: it has zero bytes",
        "check the file's kind; terraport reads LAS, LAZ, PLY, PCD, E57, PTX and text",
        f"byte {head.index(0):,}",
    )


class CleanText(io.RawIOBase):
    """The rows of a text file as a stream for pyarrow.

    Comments, lines above the first row, surplus blanks, and lines with the number of points of the
    next block are skipped; UTF-16 is converted to UTF-8.

    Parameters
    ----------
    file : binary file
        Positioned at its beginning.
    encoding : str
        Result of :func:`text_encoding`.
    delimiter : str
        Delimiter of values; a blank means any run of blanks and tabs.
    skip_lines : int
        Lines before the first row, comments not included.
    counted : bool
        True if lines with a single whole number are point counts.
    advance : callable
        Called with the number of bytes read since the last call.
    """

    def __init__(
        self,
        file: io.BufferedReader,
        *,
        encoding: str,
        delimiter: str,
        skip_lines: int,
        counted: bool,
        advance: Callable[[int], None],
    ) -> None:
        super().__init__()
        self._blocks = _blocks(file, encoding)
        self._blanks = delimiter == " "
        self._edges = _TAIL_OF_TABS if delimiter == "\t" else _EDGES
        self._counted = counted
        self.counts = 0
        """Sum of the point counts found between the rows."""
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
            block, size = next(self._blocks, (b"", 0))
            if not size:
                return 0
            self._advance(size)
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
        block = self._edges.sub(b"", block)
        while self._skip and block:
            line, _, block = block.partition(b"\n")
            self._skip -= bool(line.strip())
        if self._counted:
            self.counts += sum(map(int, _COUNT.findall(block)))
            block = _COUNT.sub(b"", block)
        return block


def _blocks(file: io.BufferedReader, encoding: str) -> Iterator[tuple[bytes, int]]:
    """Yield blocks of whole lines in an ASCII-compatible encoding, and their length in the file."""
    if encoding == "utf-8":
        while block := file.read(BLOCK_BYTES):
            block += file.readline()
            yield block, len(block)
        return
    lines = codecs.getreader(encoding)(file)
    at = 0
    while text := lines.read(BLOCK_BYTES // 2):
        text += lines.readline()
        read, at = file.tell() - at, file.tell()
        yield text.encode(), max(read, 1)
