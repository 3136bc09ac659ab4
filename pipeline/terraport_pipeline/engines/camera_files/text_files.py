"""Text of other programs, line by line and number by number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines.camera_files.raw_cameras import AGAIN, check_size
from terraport_pipeline.errors import ReadError

__all__ = ["next_numbers", "parse_numbers", "plain_name", "read_small_text", "text_lines"]

_MAX_SMALL_BYTES: Final = 1 << 16
"""Offsets and lists of names that stand beside the cameras."""

_MAX_LINE_BYTES: Final = 64 << 20
"""COLMAP writes all tie points of a photo into one line; a million of them are 40 MB."""


def text_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Read a text file line by line.

    Yields
    ------
    number : int
        From 1.
    text : str
        Without blanks around it.

    Raises
    ------
    ReadError
        A line beyond every bound, or bytes that are no text.
    """
    number = 0
    with path.open("rb") as file:
        while line := file.readline(_MAX_LINE_BYTES + 1):
            number += 1
            if len(line) > _MAX_LINE_BYTES or b"\0" in line:
                raise ReadError(path, "this is no line of text", AGAIN, f"line {number:,}")
            text = line.decode("utf-8", errors="surrogateescape")
            yield number, text.removeprefix("\ufeff").strip()


def parse_numbers(
    path: Path, number: int, words: Sequence[str], expected: int, what: str
) -> list[float]:
    """Parse finite numbers of one line.

    Parameters
    ----------
    path : Path
    number : int
        The line's.
    words : sequence of str
    expected : int
        How many there should be.
    what : str
        Named in the error.

    Raises
    ------
    ReadError
        Another count, no number, NaN or infinity.
    """
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != expected or not np.isfinite(values).all():
        excerpt = " ".join(words)[:80]
        raise ReadError(
            path,
            f"{excerpt!r} is not {what} ({expected} finite numbers)",
            AGAIN,
            f"line {number:,}",
        )
    return values


def read_small_text(path: Path) -> str:
    """Read a file of a few lines.

    Raises
    ------
    ReadError
        Above 64 KiB.
    """
    check_size(path, _MAX_SMALL_BYTES, "give the file that the program wrote")
    return path.read_bytes().decode("utf-8", errors="replace")


def next_numbers(
    path: Path, lines: Iterator[tuple[int, str]], what: str, expected: int
) -> list[float]:
    """Parse the numbers of the next line.

    Raises
    ------
    ReadError
        The file ends, or :func:`parse_numbers` refuses the line.
    """
    number, text = next(lines, (0, ""))
    if not number:
        raise ReadError(path, f"the file ends before {what}", "copy or export it again")
    return parse_numbers(path, number, text.split(), expected, what)


def plain_name(name: str) -> str:
    r"""Write a photo's name with slashes, below its folder.

    Examples
    --------
    >>> plain_name(r".\flight\1.jpg"), plain_name("./1.jpg")
    ('flight/1.jpg', '1.jpg')
    """
    return name.replace("\\", "/").removeprefix("./")
