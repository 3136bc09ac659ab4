"""The segment index: what is known of every segment without reading its payload.

A :mod:`~terraport_payload.flatfile` with magic ``TPSEGIDX``; 64 bytes per segment, held in memory
whole.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from terraport_payload import PayloadError
from terraport_payload.flatfile import decode_flat, encode_flat
from terraport_payload.types import AnyArray, Bool, Float32, UInt16, UInt32, UInt64

__all__ = ["INDEX_MAGIC", "SegmentIndex"]

INDEX_MAGIC: Final = b"TPSEGIDX"
"""First eight bytes of every ``segments.idx``."""

_SHAPES: Final[dict[str, tuple[str, int]]] = {
    "bounds": ("<f4", 6),
    "vertex_count": ("<u4", 1),
    "face_count": ("<u4", 1),
    "offset": ("<u8", 1),
    "length": ("<u4", 1),
    "xxh3": ("<u8", 1),
    "region": ("<u4", 1),
    "region_count": ("<u2", 1),
    "texture": ("<u2", 3),
}

_OPTIONAL: Final = "texture"
"""May be absent: a reader then takes the largest that there can be (section 6 of the format)."""


@dataclass(frozen=True, slots=True)
class SegmentIndex:
    """One row per payload, in pack order: of S segments, 0 to S - 1, then of their coarser levels.

    Raises
    ------
    PayloadError
        When arrays differ in length or dtype, a box is not finite or its minimum exceeds its
        maximum, a segment is empty, or payloads overlap or are out of order.
    """

    bounds: Float32
    """(S, 6) metres, scene frame: x, y, z minimum, x, y, z maximum; exact for the decoded
    positions."""
    vertex_count: UInt32
    """(S,)"""
    face_count: UInt32
    """(S,)"""
    offset: UInt64
    """(S,) where the payload starts in the pack, bytes; a multiple of 64, ascending."""
    length: UInt32
    """(S,) payload bytes."""
    xxh3: UInt64
    """(S,) XXH3-64 (seed 0) of the payload."""
    region: UInt32
    """(S,) id of the region with most faces in the segment."""
    region_count: UInt16
    """(S,) number of regions in the segment."""
    texture: UInt16
    """(S, 3) width and height of the image, pixels, and what a GPU keeps of a texel, bits; zeros
    without a texture."""

    def __post_init__(self) -> None:
        rows = len(self.bounds)
        for name, (dtype, components) in _SHAPES.items():
            values: AnyArray = getattr(self, name)
            shape = (rows,) if components == 1 else (rows, components)
            if values.dtype != np.dtype(dtype) or values.shape != shape:
                raise PayloadError(
                    f"index field {name!r} is {values.dtype} {values.shape}, "
                    f"expected {np.dtype(dtype)} {shape}"
                )
        self._check("box is not finite or turned over", ~_proper(self.bounds))
        self._check(
            "no vertex, face or byte",
            (self.vertex_count == 0) | (self.face_count == 0) | (self.length == 0),
        )
        end = self.offset + self.length.astype(np.uint64)
        self._check("payload runs past 2^64 bytes", end < self.offset)
        overlap = np.zeros(rows, dtype=bool)
        overlap[1:] = self.offset[1:] < end[:-1]
        self._check("payload starts before its predecessor ends", overlap)

    def __len__(self) -> int:
        return len(self.bounds)

    def first(self, count: int) -> SegmentIndex:
        """Return the index of the first payloads alone; views of the same arrays."""
        if count == len(self):
            return self
        return SegmentIndex(
            **{field.name: getattr(self, field.name)[:count] for field in fields(self)}
        )

    @property
    def payload_bytes(self) -> int:
        """Sum of all payloads' lengths, without the padding between them."""
        return int(self.length.sum(dtype=np.uint64))

    @property
    def end(self) -> int:
        """First byte of the pack after the last payload; 0 without segments."""
        return int(self.offset[-1]) + int(self.length[-1]) if len(self) else 0

    def to_bytes(self) -> bytes:
        """Write ``segments.idx``; same input, same bytes."""
        return encode_flat(
            INDEX_MAGIC,
            len(self),
            {field.name: getattr(self, field.name) for field in fields(self)},
        )

    @classmethod
    def from_bytes(
        cls, data: bytes | memoryview, *, largest: tuple[int, int, int] = (0, 0, 0)
    ) -> SegmentIndex:
        """Read ``segments.idx``; every truncation and flipped bit is noticed.

        Parameters
        ----------
        data : bytes or memoryview
            The whole file.
        largest : (int, int, int), optional
            What ``texture`` is taken to be, of every segment, in a file that does not say it.

        Returns
        -------
        SegmentIndex
            Read-only views of *data*.

        Raises
        ------
        PayloadError
            With the offset where one is known.
        """
        rows, fields = decode_flat(data, INDEX_MAGIC)
        if _OPTIONAL not in fields:
            fields[_OPTIONAL] = np.tile(np.array(largest, "<u2"), (rows, 1))
        missing = [name for name in _SHAPES if name not in fields]
        if missing:
            raise PayloadError(f"no field {missing[0]!r} in the index")
        columns: dict[str, Any] = {name: fields[name] for name in _SHAPES}
        index = cls(**columns)
        if len(index) != rows:
            raise PayloadError(f"index of {len(index)} segments, expected {rows} by the header")
        return index

    @staticmethod
    def _check(what: str, wrong: Bool) -> None:
        if bool(wrong.any()):
            raise PayloadError(f"segment {int(np.argmax(wrong))}: {what}")


def _proper(bounds: Float32) -> Bool:
    ordered = (bounds[:, :3] <= bounds[:, 3:]).all(axis=1)
    return np.asarray(np.isfinite(bounds).all(axis=1) & ordered, dtype=np.bool_)
