"""Packed arrays of the wire: segment ids, held segments, load tables.

On the wire each is one binary field of little-endian rows.  In Python each is a read-only NumPy
array, so that a plan of 1,000 segments costs one copy and no objects.
"""

# ruff: noqa: D102 - the interface Kind documents these methods
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .kinds import Refused, clip
from .limits import MAX_COORDINATE_M, MAX_SEGMENT_BYTES

__all__ = ["HELD_DTYPE", "ID_DTYPE", "LOAD_DTYPE", "HeldTable", "Ids", "LoadTable"]

ID_DTYPE = np.dtype("<u4")
"""One segment id: its row in the scene's index."""

HELD_DTYPE = np.dtype([("id", "<u4"), ("xxh3", "<u8")])
"""One held segment, 12 bytes: id and content hash (XXH3, 64 bit) of its payload."""

LOAD_DTYPE = np.dtype(
    [
        ("id", "<u4"),
        ("length", "<u4"),
        ("xxh3", "<u8"),
        ("faces", "<u4"),
        ("vertices", "<u4"),
        ("bounds", "<f4", (6,)),
    ]
)
"""One segment to load, 48 bytes: payload length in bytes, its hash, counts, and the box in metres
of the scene frame (min x, y, z, max x, y, z)."""

_U32 = 2**32 - 1


class _Packed:
    """Rows of one dtype, unique by id, at most `most`."""

    dtype: np.dtype[Any]
    noun = "rows"

    def __init__(self, most: int) -> None:
        self.most = most

    def check(self, value: Any) -> NDArray[Any]:
        rows = self._as_rows(value)
        if len(rows) > self.most:
            raise Refused(f"got {len(rows)} {self.noun}, expected at most {self.most}")
        ids = rows["id"] if self.dtype.names else rows
        # Ascending as a rule; to look is a tenth of sorting, and a table may have 32,768 rows.
        if not (ids[1:] > ids[:-1]).all():
            ordered = np.sort(ids)
            repeated = ordered[1:][ordered[1:] == ordered[:-1]]
            if len(repeated):
                raise Refused(f"got id {int(repeated[0])} twice, expected each id once")
        self._check_rows(rows)
        if rows.flags.writeable:
            rows = rows.copy()
            rows.setflags(write=False)
        return rows

    def _as_rows(self, value: Any) -> NDArray[Any]:
        if not isinstance(value, np.ndarray):
            try:
                value = np.array(value, dtype=self.dtype)
            except (TypeError, ValueError, OverflowError) as error:
                raise Refused(
                    f"got {clip(value)}, expected {self.noun} of dtype {self.dtype}"
                ) from error
        if value.ndim != 1:
            raise Refused(f"got {value.ndim} dimensions, expected one")
        if value.dtype != self.dtype:
            value = self._cast(value)
        return np.ascontiguousarray(value)

    def _cast(self, value: NDArray[Any]) -> NDArray[Any]:
        raise Refused(f"got dtype {value.dtype}, expected {self.dtype}")

    def _check_rows(self, rows: NDArray[Any]) -> None:
        """Check what goes beyond the dtype."""

    def to_wire(self, value: Any) -> bytes:
        data: bytes = value.tobytes()
        return data

    def from_wire(self, raw: Any) -> NDArray[Any]:
        size = self.dtype.itemsize
        if not isinstance(raw, bytes) or len(raw) % size:
            raise Refused(f"got {clip(raw)}, expected binary of a multiple of {size} bytes")
        if len(raw) > self.most * size:
            raise Refused(f"got {len(raw) // size} {self.noun}, expected at most {self.most}")
        return np.frombuffer(raw, dtype=self.dtype)


class Ids(_Packed):
    """Segment ids, each once: shape (N,) uint32, 4 bytes each."""

    dtype = ID_DTYPE
    noun = "ids"

    def _cast(self, value: NDArray[Any]) -> NDArray[Any]:
        if len(value) == 0:
            return np.zeros(0, dtype=self.dtype)
        if value.dtype.kind not in "iu" or int(value.min()) < 0 or int(value.max()) > _U32:
            raise Refused(f"got dtype {value.dtype} or ids beyond 32 bits, expected {self.dtype}")
        return value.astype(self.dtype)

    def _as_rows(self, value: Any) -> NDArray[Any]:
        if not isinstance(value, np.ndarray):
            value = _u32_list(list(value) if isinstance(value, (tuple, range)) else value)
        return super()._as_rows(value)

    def schema(self) -> dict[str, Any]:
        return {
            "type": "array",
            "items": _u32_schema(),
            "maxItems": self.most,
            "uniqueItems": True,
            "x-msgpack": "binary: uint32 little-endian each",
        }

    def describe(self) -> str:
        return f"ids, at most {self.most}"


class HeldTable(_Packed):
    """Held segments: shape (N,) of `HELD_DTYPE`."""

    dtype = HELD_DTYPE
    noun = "held segments"

    def schema(self) -> dict[str, Any]:
        item = {
            "type": "array",
            "prefixItems": [_u32_schema(), _hash_schema()],
            "items": False,
            "minItems": 2,
        }
        return {
            "type": "array",
            "items": item,
            "maxItems": self.most,
            "x-msgpack": "binary: rows of 12 bytes, id uint32 + xxh3 uint64, little-endian",
        }

    def describe(self) -> str:
        return f"held table, at most {self.most}"


class LoadTable(_Packed):
    """Segments to load: shape (N,) of `LOAD_DTYPE`."""

    dtype = LOAD_DTYPE
    noun = "segments"

    def _check_rows(self, rows: NDArray[Any]) -> None:
        if len(rows) == 0:
            return
        longest, shortest = int(rows["length"].max()), int(rows["length"].min())
        if shortest < 1 or longest > MAX_SEGMENT_BYTES:
            wrong = shortest if shortest < 1 else longest
            raise Refused(f"got a length of {wrong}, expected 1 to {MAX_SEGMENT_BYTES}", "length")
        bounds = rows["bounds"]
        # A NaN fails the first comparison, an infinity too: no separate test is needed.
        if not (np.abs(bounds) <= MAX_COORDINATE_M).all():
            raise Refused(
                f"got a coordinate that is no number of size at most {MAX_COORDINATE_M:.15g}",
                "bounds",
            )
        if (bounds[:, :3] > bounds[:, 3:]).any():
            raise Refused("got a box whose min is above its max, expected min <= max", "bounds")

    def schema(self) -> dict[str, Any]:
        number = {"type": "number", "minimum": -MAX_COORDINATE_M, "maximum": MAX_COORDINATE_M}
        properties = {
            "id": _u32_schema(),
            "length": {"type": "integer", "minimum": 1, "maximum": MAX_SEGMENT_BYTES},
            "xxh3": _hash_schema(),
            "faces": _u32_schema(),
            "vertices": _u32_schema(),
            "bounds": {"type": "array", "items": number, "minItems": 6, "maxItems": 6},
        }
        item = {"type": "object", "properties": properties, "required": list(properties)}
        return {
            "type": "array",
            "items": item,
            "maxItems": self.most,
            "x-msgpack": "binary: rows of 48 bytes, little-endian (see the load table)",
        }

    def describe(self) -> str:
        return f"load table, at most {self.most}"


def _fast_u32(values: list[Any]) -> NDArray[np.int64] | None:
    """Return ids or counts as an array; None where one of them is no such number."""
    if set(map(type, values)) != {int}:
        return None
    try:
        numbers = np.array(values, dtype=np.int64)
    except OverflowError:
        return None
    return numbers if numbers.min() >= 0 and numbers.max() <= _U32 else None


def _u32(value: Any, path: str) -> int:
    if type(value) is not int or not 0 <= value <= _U32:
        raise Refused(f"got {clip(value)}, expected an integer from 0 to {_U32}", path)
    return value


def _u32_list(raw: Any) -> NDArray[np.uint32]:
    if not isinstance(raw, list):
        raise Refused(f"got {clip(raw)}, expected a list of ids")
    numbers = _fast_u32(raw) if raw else None
    if numbers is not None:
        return numbers.astype(ID_DTYPE)
    items = [int(item) if isinstance(item, np.integer) else item for item in raw]
    return np.array([_u32(item, str(n)) for n, item in enumerate(items)], dtype=ID_DTYPE)


def _u32_schema() -> dict[str, Any]:
    return {"type": "integer", "minimum": 0, "maximum": _U32}


def _hash_schema() -> dict[str, Any]:
    return {"type": "string", "pattern": "^[0-9a-f]{16}$"}
