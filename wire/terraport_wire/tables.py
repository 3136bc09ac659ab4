"""Packed arrays of the wire: segment ids, held segments, load tables.

In msgpack each is one binary field of little-endian rows; in JSON a list.  In Python each is a
read-only NumPy array, so that a plan of 1,000 segments costs one copy and no objects.
"""

# ruff: noqa: D102 - the interface Kind documents these methods
from __future__ import annotations

import re
from itertools import chain
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
_HASH = re.compile(r"[0-9a-f]{16}")
_HEX = re.compile(r"[0-9a-f]*")


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
        if len(ids) > 1:
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

    def to_wire(self, value: Any, *, packed: bool) -> Any:
        return value.tobytes() if packed else self._to_list(value)

    def from_wire(self, raw: Any, *, packed: bool) -> NDArray[Any]:
        if not packed:
            if not isinstance(raw, list):
                raise Refused(f"got {clip(raw)}, expected a list")
            if len(raw) > self.most:
                raise Refused(f"got {len(raw)} {self.noun}, expected at most {self.most}")
            return self._from_list(raw)
        size = self.dtype.itemsize
        if not isinstance(raw, bytes) or len(raw) % size:
            raise Refused(f"got {clip(raw)}, expected binary of a multiple of {size} bytes")
        if len(raw) > self.most * size:
            raise Refused(f"got {len(raw) // size} {self.noun}, expected at most {self.most}")
        return np.frombuffer(raw, dtype=self.dtype)

    def _to_list(self, rows: NDArray[Any]) -> list[Any]:
        raise NotImplementedError

    def _from_list(self, raw: list[Any]) -> NDArray[Any]:
        raise NotImplementedError


class Ids(_Packed):
    """Segment ids, each once: shape (N,) uint32; packed 4 bytes each; a list in JSON."""

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

    def _to_list(self, rows: NDArray[Any]) -> list[Any]:
        return list(rows.tolist())

    def _from_list(self, raw: list[Any]) -> NDArray[Any]:
        return _u32_list(raw)

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
    """Held segments: shape (N,) of `HELD_DTYPE`; ``[[id, "hash"], ...]`` in JSON."""

    dtype = HELD_DTYPE
    noun = "held segments"

    def _to_list(self, rows: NDArray[Any]) -> list[Any]:
        return [list(row) for row in zip(rows["id"].tolist(), _to_hex(rows["xxh3"]), strict=True)]

    def _from_list(self, raw: list[Any]) -> NDArray[Any]:
        rows = np.zeros(len(raw), dtype=self.dtype)
        if raw and set(map(type, raw)) == {list} and set(map(len, raw)) == {2}:
            ids = _fast_u32([item[0] for item in raw])
            hashes = _fast_hashes([item[1] for item in raw])
            if ids is not None and hashes is not None:
                rows["id"], rows["xxh3"] = ids, hashes
                return rows
        # One by one: something is wrong, and the answer says where.
        for number, item in enumerate(raw):
            if not isinstance(item, list) or len(item) != 2:
                raise Refused(f"got {clip(item)}, expected [id, hash]", str(number))
            rows[number] = (_u32(item[0], str(number)), _hash(item[1], str(number)))
        return rows

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
    """Segments to load: shape (N,) of `LOAD_DTYPE`; a list of objects in JSON."""

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

    def _to_list(self, rows: NDArray[Any]) -> list[Any]:
        columns = [
            _to_hex(rows[name]) if name == "xxh3" else rows[name].tolist()
            for name in LOAD_DTYPE.names or ()
        ]
        return [
            {
                "id": segment,
                "length": length,
                "xxh3": xxh3,
                "faces": faces,
                "vertices": vertices,
                "bounds": bounds,
            }
            for segment, length, xxh3, faces, vertices, bounds in zip(*columns, strict=True)
        ]

    def _from_list(self, raw: list[Any]) -> NDArray[Any]:
        rows = np.zeros(len(raw), dtype=self.dtype)
        if not _fill_load_rows(rows, raw):
            # One by one: something is wrong, and the answer says where.
            for number, item in enumerate(raw):
                rows[number] = _load_row(item, str(number))
        return rows

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


def _fill_load_rows(rows: NDArray[Any], raw: list[Any]) -> bool:
    """Fill all rows at once, column by column; False where any of them is not as it should be."""
    if not raw or set(map(type, raw)) != {dict}:
        return False
    try:
        boxes = [item["bounds"] for item in raw]
        columns: dict[str, NDArray[Any] | None] = {
            name: _fast_u32([item[name] for item in raw])
            for name in ("id", "length", "faces", "vertices")
        }
        columns["xxh3"] = _fast_hashes([item["xxh3"] for item in raw])
    except KeyError:
        return False
    if set(map(type, boxes)) != {list} or set(map(len, boxes)) != {6}:
        return False
    numbers = list(chain.from_iterable(boxes))
    if not set(map(type, numbers)) <= {int, float}:
        return False
    try:
        bounds = np.array(numbers, dtype=np.float64)
    except OverflowError:  # an integer of hundreds of digits
        return False
    if any(column is None for column in columns.values()):
        return False
    if not (np.abs(bounds) <= MAX_COORDINATE_M).all():
        return False
    for name, column in columns.items():
        rows[name] = column
    rows["bounds"] = bounds.reshape(-1, 6)
    return True


def _fast_u32(values: list[Any]) -> NDArray[np.int64] | None:
    """Return ids or counts as an array; None where one of them is no such number."""
    if set(map(type, values)) != {int}:
        return None
    try:
        numbers = np.array(values, dtype=np.int64)
    except OverflowError:
        return None
    return numbers if numbers.min() >= 0 and numbers.max() <= _U32 else None


def _fast_hashes(values: list[Any]) -> NDArray[np.uint64] | None:
    """Return hashes as an array; None where one of them is no hash."""
    if set(map(type, values)) != {str} or set(map(len, values)) != {16}:
        return None
    text = "".join(values)
    if not _HEX.fullmatch(text):
        return None
    return np.frombuffer(bytes.fromhex(text), dtype=">u8").astype(np.uint64)


def _to_hex(hashes: NDArray[np.uint64]) -> list[str]:
    """Return 16 hexadecimal digits of each."""
    text = hashes.astype(">u8").tobytes().hex()
    return [text[at : at + 16] for at in range(0, len(text), 16)]


def _load_row(item: Any, place: str) -> tuple[Any, ...]:
    if not isinstance(item, dict):
        raise Refused(f"got {clip(item)}, expected a segment object", place)
    bounds = item.get("bounds")
    if not isinstance(bounds, list) or len(bounds) != 6:
        raise Refused(f"got {clip(bounds)}, expected six numbers", f"{place}.bounds")
    for number in bounds:
        # Compared as Python numbers: an integer of 400 digits must not reach float().
        if type(number) not in (int, float) or not -MAX_COORDINATE_M <= number <= MAX_COORDINATE_M:
            raise Refused(
                f"got {clip(number)}, expected a number of size at most {MAX_COORDINATE_M:.15g}",
                f"{place}.bounds",
            )
    return (
        _u32(item.get("id"), f"{place}.id"),
        _u32(item.get("length"), f"{place}.length"),
        _hash(item.get("xxh3"), f"{place}.xxh3"),
        _u32(item.get("faces"), f"{place}.faces"),
        _u32(item.get("vertices"), f"{place}.vertices"),
        bounds,
    )


def _u32(value: Any, place: str) -> int:
    if type(value) is not int or not 0 <= value <= _U32:
        raise Refused(f"got {clip(value)}, expected an integer from 0 to {_U32}", place)
    return value


def _u32_list(raw: Any) -> NDArray[np.uint32]:
    if not isinstance(raw, list):
        raise Refused(f"got {clip(raw)}, expected a list of ids")
    numbers = _fast_u32(raw) if raw else None
    if numbers is not None:
        return numbers.astype(ID_DTYPE)
    items = [int(item) if isinstance(item, np.integer) else item for item in raw]
    return np.array([_u32(item, str(n)) for n, item in enumerate(items)], dtype=ID_DTYPE)


def _hash(value: Any, place: str) -> int:
    if not isinstance(value, str) or not _HASH.fullmatch(value):
        raise Refused(f"got {clip(value)}, expected 16 hexadecimal digits (0-9a-f)", place)
    return int(value, 16)


def _u32_schema() -> dict[str, Any]:
    return {"type": "integer", "minimum": 0, "maximum": _U32}


def _hash_schema() -> dict[str, Any]:
    return {"type": "string", "pattern": "^[0-9a-f]{16}$"}
