"""Which segments lie over each face of the base mesh: the table behind the hand-off.

A client hides a base face if and only if **all** segments over it are loaded; a face over which no
segment lies is never hidden. The table is stored once per scene as ``base.cover``, by base face
number, so the base mesh's face order is part of the format.

Layout (little-endian; byte diagram in ``spec/scene-format.md``, section 8)::

    0   magic (8)            TPCOVER1
    8   checksum u64         XXH3-64 of every byte from 16 to the end
    16  major u16, minor u16
    20  steps_offset u32     32 here; a newer minor version may lengthen the header
    24  base_faces u32, entries u32
    32  steps                to the end of the file

Neighbouring faces have equal or nearly equal rows. So a row is stored as its difference from the
row before it: steps, each of which puts a segment into the row or takes it out, and then gives the
row to so many faces. A step takes a byte where the segment is among the fifteen that steps named
last.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import struct
from array import array
from bisect import bisect_left
from dataclasses import dataclass
from typing import Final, cast

import numpy as np
import xxhash

from terraport_payload.errors import PayloadError
from terraport_payload.types import Bool, Int64, UInt32

__all__ = ["COVER_MAGIC", "MAX_COVER_BYTES", "MAX_COVER_ROWS", "MAX_ROW_SEGMENTS", "Cover"]

COVER_MAGIC: Final = b"TPCOVER1"
"""First eight bytes of every ``base.cover``."""

MAX_COVER_BYTES: Final = 1 << 26
"""Of the file. 100,000 faces take 20 to 70 KB."""

MAX_COVER_ROWS: Final = 1 << 24
"""Base faces, and entries of all rows together: a few bytes can stand for any number of them. 64
MiB each in memory."""

MAX_ROW_SEGMENTS: Final = 4096
"""Segments over one base face: bounds what one step costs. Surveys have up to ten or so."""

_MAJOR: Final = 1
_HEADER: Final = struct.Struct("<8sQHHIII")
_RECENT: Final = 15
"""How many segments a step can name by half a byte; fifteen itself says that a number follows."""


@dataclass(frozen=True, slots=True)
class Cover:
    """Segments over each base face, in compressed rows.

    Raises
    ------
    PayloadError
        When offsets do not start at 0, decrease, or do not end at the number of entries, or a row
        does not ascend.

    Examples
    --------
    >>> cover = Cover(np.array([0, 2, 2], dtype=np.uint32), np.array([4, 7], dtype=np.uint32))
    >>> cover.over(0).tolist(), cover.over(1).tolist()
    ([4, 7], [])
    """

    offsets: UInt32
    """(B + 1,) row b is ``segments[offsets[b]:offsets[b + 1]]``."""
    segments: UInt32
    """(N,) segment ids, ascending within a row."""

    def __post_init__(self) -> None:
        for name, values in (("offsets", self.offsets), ("segments", self.segments)):
            if values.dtype != np.uint32 or values.ndim != 1:
                raise PayloadError(
                    f"cover {name} are {values.dtype} {values.shape}, "
                    "expected uint32 in one dimension"
                )
        if (
            len(self.offsets) < 1
            or int(self.offsets[0]) != 0
            or int(self.offsets[-1]) != len(self.segments)
        ):
            ends = self.offsets[[0, -1]].tolist() if len(self.offsets) else []
            raise PayloadError(f"cover offsets run {ends}, expected 0 to {len(self.segments)}")
        if bool((self.offsets[1:] < self.offsets[:-1]).any()):
            face = int(np.flatnonzero(self.offsets[1:] < self.offsets[:-1])[0])
            raise PayloadError(f"cover offsets decrease at base face {face}, expected ascending")
        falls = self.segments[1:] <= self.segments[:-1]
        starts = np.zeros(len(self.segments) + 1, dtype=bool)
        starts[self.offsets] = True
        # Where a row starts, the segment may be lower than the last of the row before.
        falls &= ~starts[1 : len(falls) + 1]
        if falls.any():
            entry = int(falls.argmax()) + 1
            face = int(np.searchsorted(self.offsets, entry, side="right")) - 1
            raise PayloadError(
                f"segments over base face {face} do not ascend, expected each once, ascending"
            )

    def __repr__(self) -> str:
        """Say how large it is, not its arrays."""
        return f"<Cover of {len(self.offsets) - 1:,} faces by {len(self.segments):,} entries>"

    @property
    def base_faces(self) -> int:
        """Number of base faces, B."""
        return len(self.offsets) - 1

    def over(self, base_face: int) -> UInt32:
        """Segments over one base face.

        Parameters
        ----------
        base_face : int
            0 to base_faces - 1.

        Returns
        -------
        ndarray of uint32
            Segment ids; empty for a face that is never hidden.

        Raises
        ------
        IndexError
            When there is no such face.
        """
        if not 0 <= base_face < self.base_faces:
            raise IndexError(f"base face {base_face}, expected 0 to {self.base_faces - 1}")
        return self.segments[self.offsets[base_face] : self.offsets[base_face + 1]]

    def to_bytes(self) -> bytes:
        """Write ``base.cover``; same input, same bytes.

        Raises
        ------
        PayloadError
            When the cover is beyond the format's limits: base faces, entries, segments of a row.
        """
        rows, entries = self.base_faces, len(self.segments)
        widest = int(np.diff(self.offsets).max(initial=0))
        for count, limit, what in (
            (rows, MAX_COVER_ROWS, "base faces"),
            (entries, MAX_COVER_ROWS, "entries"),
            (widest, MAX_ROW_SEGMENTS, "segments over a base face"),
        ):
            if count > limit:
                raise PayloadError(f"cover of {count} {what}, expected at most {limit}")
        tail = struct.pack("<HHIII", _MAJOR, 0, _HEADER.size, rows, entries) + self._steps()
        return COVER_MAGIC + struct.pack("<Q", xxhash.xxh3_64_intdigest(tail)) + tail

    def _steps(self) -> bytes:
        """Return the steps from row to row; a run of equal rows is one of them."""
        starts = np.flatnonzero(self._row_changes())
        runs = np.diff(np.append(starts, self.base_faces)).tolist()
        bounds = zip(self.offsets[starts].tolist(), self.offsets[starts + 1].tolist(), strict=True)
        steps, recent, row = bytearray(), [0] * _RECENT, set[int]()
        for run, (start, end) in zip(runs, bounds, strict=True):
            following = set(self.segments[start:end].tolist())
            # Out before in: no row on the way is longer than both. Empty first rows differ by
            # nothing from the row before all rows: one segment in and out again.
            toggled = [*sorted(row - following), *sorted(following - row)]
            *others, last = toggled or [recent[0]] * 2
            for segment in others:
                _put_step(steps, recent, segment, 0)
            _put_step(steps, recent, last, run)
            row = following
        return bytes(steps)

    def _row_changes(self) -> Bool:
        """(B,) whether the row of a face is another than that of the face before it."""
        lengths = np.diff(self.offsets).astype(np.int64)
        changes = np.ones(self.base_faces, dtype=bool)
        changes[1:] = lengths[1:] != lengths[:-1]
        face_of_entry = np.repeat(np.arange(self.base_faces), lengths)
        entry_before = np.arange(len(self.segments)) - lengths[face_of_entry]
        # Of rows of one length. Elsewhere, and in the first, the answer is known.
        differs = self.segments != self.segments[np.maximum(entry_before, 0)]
        changes[face_of_entry[differs]] = True
        return changes

    @classmethod
    def from_bytes(cls, data: bytes | memoryview, base_faces: int) -> Cover:
        """Read ``base.cover``; every truncation and flipped bit is noticed.

        Parameters
        ----------
        data : bytes or memoryview
            The whole file.
        base_faces : int
            Faces of the base mesh that it belongs to. Nothing is allocated for another number.

        Returns
        -------
        Cover
            Arrays of its own.

        Raises
        ------
        PayloadError
            With the offset where one is known.
        """
        # (1) The header, then the checksum over everything after it: from here on the bytes are
        # those that were written, though not for certain by us.
        view = memoryview(data).cast("B")
        if not _HEADER.size <= len(view) <= MAX_COVER_BYTES:
            raise PayloadError(
                f"{len(view)} bytes, expected {_HEADER.size} to {MAX_COVER_BYTES}", offset=0
            )
        magic, checksum, major, _minor, start, rows, entries = _HEADER.unpack_from(view)
        if magic != COVER_MAGIC:
            raise PayloadError(f"magic {magic!r}, expected {COVER_MAGIC!r}", offset=0)
        if major != _MAJOR:
            raise PayloadError(f"format version {major}, expected {_MAJOR}", offset=16)
        actual = xxhash.xxh3_64_intdigest(view[16:])
        if actual != checksum:
            raise PayloadError(f"checksum {actual:016x}, expected {checksum:016x}", offset=8)
        # (2) What the rows will take, before they take it.
        if not _HEADER.size <= start <= len(view):
            raise PayloadError(f"steps at {start} of {len(view)} bytes", offset=20)
        if rows != base_faces:
            raise PayloadError(f"cover of {rows} base faces, expected {base_faces}", offset=24)
        if max(rows, entries) > MAX_COVER_ROWS:
            raise PayloadError(
                f"cover of {rows} base faces and {entries} entries, "
                f"expected at most {MAX_COVER_ROWS}",
                offset=24,
            )
        # (3) The rows.
        return cls(*_rows_of_steps(view, start, rows, entries))


def _put_step(steps: bytearray, recent: list[int], segment: int, run: int) -> None:
    """Append one step: a segment goes in or out, then `run` faces have the row."""
    is_recent = segment in recent
    rank = recent.index(segment) if is_recent else _RECENT
    steps.append(rank | min(run, 15) << 4)
    if is_recent:
        del recent[rank]
    else:
        # Around the end of 32 bits, where that is nearer.
        ahead = (segment - recent[0] + 2**31) % 2**32 - 2**31
        _put_number(steps, 2 * ahead if ahead >= 0 else -2 * ahead - 1)
        recent.pop()
    recent.insert(0, segment)
    if run >= 15:
        _put_number(steps, run - 15)


def _put_number(steps: bytearray, number: int) -> None:
    """Append a number, seven bits a byte, lowest first; the top bit says that more follow."""
    while number >= 0x80:
        steps.append(number & 0x7F | 0x80)
        number >>= 7
    steps.append(number)


def _number(view: memoryview, at: int) -> tuple[int, int]:
    """Read a number, and where it ends."""
    number = 0
    for shift in range(0, 35, 7):
        if at >= len(view):
            break
        number |= (view[at] & 0x7F) << shift
        at += 1
        if view[at - 1] < 0x80:
            if number >> 32:
                break
            return number, at
    raise PayloadError("a number in the steps is cut short or beyond 32 bits", offset=at)


def _rows_of_steps(view: memoryview, at: int, rows: int, entries: int) -> tuple[UInt32, UInt32]:
    """Walk the steps from `at` to the end of the file.

    Invariant: what has been given to faces is at most what the header counts, so a run of any
    length is refused before it takes memory.
    """
    recent, row = [0] * _RECENT, list[int]()
    row_entries = array("I")  # of each run once
    lengths, runs = array("I"), array("I")
    rows_left, entries_left = rows, entries
    while rows_left:
        # (1) The segment: one of the last fifteen, or so many numbers ahead of the last.
        step_at = at
        if at >= len(view):
            raise PayloadError(f"the steps end {rows_left} base faces early", offset=at)
        rank, run = view[at] & 15, view[at] >> 4
        at += 1
        if rank < _RECENT:
            segment = recent.pop(rank)
        else:
            number, at = _number(view, at)
            ahead = number >> 1 if number % 2 == 0 else ~(number >> 1)
            segment = (recent[0] + ahead) & 0xFFFFFFFF
            recent.pop()
        recent.insert(0, segment)
        # (2) In, or out.
        place = bisect_left(row, segment)
        if place < len(row) and row[place] == segment:
            del row[place]
        elif len(row) < MAX_ROW_SEGMENTS:
            row.insert(place, segment)
        else:
            raise PayloadError(
                f"more than {MAX_ROW_SEGMENTS} segments over a base face", offset=step_at
            )
        # (3) The faces that have this row.
        if run == 15:
            number, at = _number(view, at)
            run += number
        if run > rows_left or run * len(row) > entries_left:
            raise PayloadError(
                f"{run} base faces of {len(row)} segments, "
                f"expected {rows_left} faces and {entries_left} entries at most",
                offset=step_at,
            )
        if run:
            lengths.append(len(row))
            runs.append(run)
            row_entries.extend(row)
            rows_left -= run
            entries_left -= run * len(row)
    if at != len(view) or entries_left:
        raise PayloadError(
            f"{len(view) - at} bytes and {entries_left} entries left over, expected none", offset=at
        )
    return _repeated_rows(
        np.frombuffer(row_entries, dtype=np.uint32),
        np.frombuffer(lengths, dtype=np.uint32).astype(np.int64),
        np.frombuffer(runs, dtype=np.uint32).astype(np.int64),
    )


def _repeated_rows(row_entries: UInt32, lengths: Int64, runs: Int64) -> tuple[UInt32, UInt32]:
    """Give row r, of so many entries, to so many faces in a row, as offsets and segments."""
    offsets = np.concatenate([[0], np.cumsum(np.repeat(lengths, runs))])
    first_entries = np.repeat(np.cumsum(lengths) - lengths, runs)
    shift = np.repeat(first_entries - offsets[:-1], np.diff(offsets))
    segments = row_entries[np.arange(len(shift)) + shift]
    return offsets.astype(np.uint32), cast("UInt32", segments)
