"""Arrays on disk that are written and read in parts, as ordinary ``.npy`` files.

A mapped file would be shorter to write, but its pages count as this process's memory and stay until
something else needs the room; a build that promises a bound reads and writes by blocks.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from terraport_payload.types import AnyArray

__all__ = ["NpyReader", "NpyWriter", "link_or_copy"]


class NpyWriter:
    """Appends rows to a new ``.npy`` file; readable after :meth:`close`.

    A context manager: closes on success, leaves an unreadable torso on an exception. The file is
    opened for every append, so that hundreds of writers need no hundreds of handles.

    Parameters
    ----------
    path : Path
        Replaced if it is there.
    dtype : numpy dtype
        May be structured.
    row_shape : tuple of int
        ``()`` for one value a row.
    """

    def __init__(self, path: Path, dtype: npt.DTypeLike, row_shape: tuple[int, ...] = ()) -> None:
        self.path = path
        self.dtype = np.dtype(dtype)
        self.row_shape = row_shape
        self.rows = 0
        # The header comes last: only then is the number of rows known. Room for any number.
        self._header_bytes = -(-(10 + len(self._header(10**15)) + 1) // 64) * 64
        path.write_bytes(b"\0" * self._header_bytes)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()

    def append(self, rows: AnyArray) -> None:
        """Write rows of shape (n, *row_shape); converted to the file's dtype."""
        if rows.shape[1:] != self.row_shape:
            raise ValueError(f"rows of shape {rows.shape[1:]}, expected {self.row_shape}")
        whole = np.ascontiguousarray(rows, dtype=self.dtype)
        if len(whole):
            with self.path.open("ab") as file:
                file.write(whole.reshape(-1).view(np.uint8).data)
        self.rows += len(whole)

    def close(self) -> None:
        """Write the header, which needs the number of rows, and close the file."""
        room = self._header_bytes - 10
        with self.path.open("r+b") as file:
            file.write(b"\x93NUMPY\x01\x00" + room.to_bytes(2, "little"))
            file.write(self._header(self.rows).ljust(room - 1) + b"\n")

    def _header(self, rows: int) -> bytes:
        descr = np.lib.format.dtype_to_descr(self.dtype)
        shape = (rows, *self.row_shape)
        text = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape!r}, }}"
        return text.encode("latin-1")


class NpyReader:
    """Reads rows of a ``.npy`` file in parts.

    Parameters
    ----------
    path : pathlib.Path
        In C order.

    Raises
    ------
    ValueError
        No such array, or cut short.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("rb") as file:
            version = np.lib.format.read_magic(file)
            if version != (1, 0):
                raise ValueError(f"{path}: NPY version {version}, expected 1.0")
            shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
            self._start = file.tell()
        if fortran and len(shape) > 1:
            raise ValueError(f"{path}: Fortran order, expected C order")
        self.shape: tuple[int, ...] = tuple(int(side) for side in shape)
        self.dtype: np.dtype[Any] = dtype
        need = self._start + self.dtype.itemsize * int(np.prod(self.shape))
        if path.stat().st_size < need:
            raise ValueError(f"{path}: {path.stat().st_size} bytes, expected {need}")

    def __len__(self) -> int:
        return self.shape[0]

    def read(self, first: int, last: int) -> AnyArray:
        """Read rows `first` to `last`, without the last."""
        row_shape = self.shape[1:]
        items = int(np.prod(row_shape))
        rows = np.fromfile(
            self.path,
            dtype=self.dtype,
            count=(last - first) * items,
            offset=self._start + first * items * self.dtype.itemsize,
        )
        return rows.reshape(last - first, *row_shape)

    def blocks(self, rows: int) -> Iterator[tuple[int, AnyArray]]:
        """Yield (first row, rows) one after the other."""
        for first in range(0, len(self), rows):
            yield first, self.read(first, min(first + rows, len(self)))


def link_or_copy(source: str | Path, target: str | Path) -> None:
    """Give a file a second name; copies it where the file system has no hard links.

    For files that are replaced and never changed in place.
    """
    try:
        Path(target).hardlink_to(source)
    except OSError:
        shutil.copy2(source, target)
