"""Which pieces of a large file to read, where a sample of its points is enough.

Pieces are what a reader can reach without reading what lies before: chunks of LAZ, runs of rows,
stretches of text. They are spread evenly over the file, and each is read whole: how densely its
points lie is then seen as it is, which no thinning shows.
"""

from __future__ import annotations

import codecs
import contextlib
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Int64
from terraport_pipeline.engines.readers.survey_chunk import StreamChunk

__all__ = ["first_chunks", "spread_pieces", "text_sample", "text_share"]

_HEAD_BYTES: Final = 1 << 16
"""Beginning of a text that every sample keeps: header and comments stand there."""

_STRETCH_BYTES: Final = 1 << 18
"""Text that is read at a place: some 6,000 lines."""


def spread_pieces(rows: Int64, share: float) -> Bool:
    """Choose pieces of a file, evenly spread, that hold about a share of its rows.

    Parameters
    ----------
    rows : ndarray of shape (B,), int64
        Rows of each piece, in file order.
    share : float
        Above 0; 1 takes all.

    Returns
    -------
    ndarray of shape (B,), bool
        One piece at least, where any has rows.

    Examples
    --------
    >>> spread_pieces(np.full(8, 100), 0.25).tolist()
    [False, True, False, False, False, True, False, False]
    """
    chosen = np.zeros(len(rows), bool)
    # Error diffusion: what a piece is owed is carried on until half of it is.
    owed = 0.0
    for piece, count in enumerate(rows.tolist()):
        owed += share * count
        if count and 2.0 * owed >= count:
            chosen[piece] = True
            owed -= count
    if not chosen.any() and rows.any():
        chosen[int(rows.argmax())] = True
    return chosen


def first_chunks(chunks: Iterable[StreamChunk], total: int, share: float) -> Iterator[StreamChunk]:
    """Yield the first chunks of a file that can only be read from its beginning.

    Parameters
    ----------
    chunks : iterable of StreamChunk
    total : int
        What all chunks' ``read`` add up to.
    share : float
        Of `total`, about; one chunk at least.
    """
    read = 0
    for chunk in chunks:
        yield chunk
        read += chunk.read
        if read >= share * total:
            return


@contextlib.contextmanager
def text_sample(path: Path, share: float) -> Iterator[Path]:
    """Write a share of a text's lines to a file of the same name in a folder that goes again.

    The beginning is always there; whole lines from places evenly spread over the rest follow.
    """
    size = path.stat().st_size
    count = _stretches(size, share)
    with tempfile.TemporaryDirectory(prefix="terraport-text-") as folder:
        sample = Path(folder, path.name)
        with path.open("rb") as source, sample.open("wb") as target:
            # In UTF-16 LE, a zero byte follows the newline byte.
            wide = source.read(2) == codecs.BOM_UTF16_LE
            source.seek(0)

            def rest_of_line() -> bytes:
                return source.readline() + (source.read(1) if wide else b"")

            target.write(source.read(_HEAD_BYTES) + rest_of_line())
            begin = source.tell()
            for number in range(count):
                middle = begin + int((number + 0.5) * max(size - begin, 0) / count)
                if middle - _STRETCH_BYTES // 2 > source.tell():
                    source.seek(middle - middle % 2 - _STRETCH_BYTES // 2)
                    rest_of_line()
                target.write(source.read(_STRETCH_BYTES) + rest_of_line())
        yield sample


def text_share(size: int, share: float) -> float:
    """Share of a text of so many bytes that :func:`text_sample` takes, where it is asked for."""
    return min(1.0, (_HEAD_BYTES + _stretches(size, share) * _STRETCH_BYTES) / size)


def _stretches(size: int, share: float) -> int:
    return max(1, round(share * size / _STRETCH_BYTES))
