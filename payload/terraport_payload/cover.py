"""Which segments lie over each face of the base mesh: the table behind the hand-off.

A client hides a base face if and only if **all** segments over it are loaded; a face over which no
segment lies is never hidden. The table is stored once per scene as ``base.cover`` (a
:mod:`~terraport_payload.flatfile` with magic ``TPCOVER1``), by base face number, so the base mesh's
face order is part of the format.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, cast

import numpy as np

from terraport_payload.errors import PayloadError
from terraport_payload.flatfile import decode_flat, encode_flat
from terraport_payload.types import AnyArray, UInt32

__all__ = ["COVER_MAGIC", "Cover"]

COVER_MAGIC: Final = b"TPCOVER1"
"""First eight bytes of every ``base.cover``."""


@dataclass(frozen=True, slots=True)
class Cover:
    """Segments over each base face, in compressed rows.

    Raises
    ------
    PayloadError
        When offsets do not start at 0, decrease, or do not end at the number of entries.

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
        """Write ``base.cover``; same input, same bytes."""
        fields: dict[str, AnyArray] = {"offsets": self.offsets, "segments": self.segments}
        return encode_flat(COVER_MAGIC, self.base_faces, fields)

    @classmethod
    def from_bytes(cls, data: bytes | memoryview) -> Cover:
        """Read ``base.cover``; every truncation and flipped bit is noticed.

        Parameters
        ----------
        data : bytes or memoryview
            The whole file.

        Returns
        -------
        Cover
            Read-only views of *data*.

        Raises
        ------
        PayloadError
            With the offset where one is known.
        """
        rows, fields = decode_flat(data, COVER_MAGIC)
        for name in ("offsets", "segments"):
            if name not in fields:
                raise PayloadError(f"no field {name!r} in the cover")
        offsets = cast("UInt32", fields["offsets"])  # __post_init__ looks
        segments = cast("UInt32", fields["segments"])
        cover = cls(offsets, segments)
        if cover.base_faces != rows:
            raise PayloadError(
                f"cover of {cover.base_faces} base faces, expected {rows} by the header"
            )
        return cover
