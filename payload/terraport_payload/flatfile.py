"""A file of named arrays: ``segments.idx`` is one.

Layout (little-endian; byte diagram in ``spec/scene-format.md``, section "Flat file")::

    0   magic (8)            kind of file, ASCII
    8   checksum u64         XXH3-64 of every byte from 16 to the end
    16  major u16, minor u16
    20  directory_offset u32 48 here; a newer minor version may lengthen the header
    24  file_bytes u64
    32  field_count u32, entry_bytes u32 (96 here; a newer minor version may lengthen an entry)
    40  row_count u32, reserved u32
    48  directory            field_count entries
    ..  arrays               each at a multiple of 8 bytes, zero padding between

A reader skips fields it does not know, so new fields need no new major version.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt
import xxhash

from terraport_payload.errors import PayloadError

__all__ = ["MAX_FIELDS", "MAX_NAME_BYTES", "decode_flat", "encode_flat"]

MAJOR: Final = 1
MINOR: Final = 0

MAX_FIELDS: Final = 256
"""Bounds the directory at 24 KiB; a survey has a few dozen attributes at the very most."""

MAX_NAME_BYTES: Final = 72
"""UTF-8 bytes of a field's name."""

_HEADER: Final = struct.Struct("<8sQHHIQIIII")
_ENTRY: Final = struct.Struct(f"<{MAX_NAME_BYTES}sBBHIQQ")
_ALIGNMENT: Final = 8

_DTYPES: Final[dict[int, np.dtype[np.generic]]] = {
    1: np.dtype("<i1"),
    2: np.dtype("<u1"),
    3: np.dtype("<i2"),
    4: np.dtype("<u2"),
    5: np.dtype("<u4"),
    6: np.dtype("<f4"),
    7: np.dtype("<u8"),
}
"""Element types by their code; 1..6 in the order of glTF's componentTypes, 7 added for offsets and
hashes."""

_CODES: Final = {dtype: code for code, dtype in _DTYPES.items()}


def encode_flat(magic: bytes, rows: int, fields: Mapping[str, npt.NDArray[np.generic]]) -> bytes:
    """Write named arrays as one flat file.

    Parameters
    ----------
    magic : bytes
        Eight bytes that name the kind of file.
    rows : int
        The header's row count (what it counts is the kind's own business).
    fields : mapping of str to ndarray of shape (n,) or (n, k)
        Written in the mapping's order; int8, uint8, int16, uint16, uint32, uint64 or float32, k <=
        255.

    Returns
    -------
    bytes
        Same input, same bytes.

    Raises
    ------
    PayloadError
        When a name is longer than 72 bytes of UTF-8 or holds NUL, a dtype is none of the above, or
        there are more than 256 fields.

    Examples
    --------
    >>> data = encode_flat(b"EXAMPLE1", 2, {"id": np.array([7, 8], dtype=np.uint32)})
    >>> len(data), decode_flat(data, b"EXAMPLE1")[1]["id"].tolist()
    (152, [7, 8])
    """
    if len(fields) > MAX_FIELDS:
        raise PayloadError(f"{len(fields)} fields, expected at most {MAX_FIELDS}")
    offset = _HEADER.size + _ENTRY.size * len(fields)
    directory: list[bytes] = []
    body: list[bytes] = []
    for name, values in fields.items():
        encoded_name = name.encode("utf-8")
        if not 0 < len(encoded_name) <= MAX_NAME_BYTES or b"\0" in encoded_name:
            raise PayloadError(
                f"field name {name!r} has {len(encoded_name)} bytes of UTF-8, "
                f"expected 1 to {MAX_NAME_BYTES} without NUL"
            )
        code = _CODES.get(values.dtype.newbyteorder("<"))
        if code is None or values.ndim not in (1, 2):
            raise PayloadError(
                f"field {name!r} is {values.dtype} of {values.ndim} dimensions, "
                "expected one or two dimensions of "
                + ", ".join(dtype.name for dtype in _DTYPES.values())
            )
        components = 1 if values.ndim == 1 else values.shape[1]
        if not 1 <= components <= 255:
            raise PayloadError(f"field {name!r} has {components} components, expected 1 to 255")
        raw = np.ascontiguousarray(values, dtype=_DTYPES[code]).tobytes()
        directory.append(
            _ENTRY.pack(encoded_name, code, components, 0, values.shape[0], offset, len(raw))
        )
        padding = -len(raw) % _ALIGNMENT
        body.append(raw + bytes(padding))
        offset += len(raw) + padding
    tail = struct.pack(
        "<HHIQIIII", MAJOR, MINOR, _HEADER.size, offset, len(fields), _ENTRY.size, rows, 0
    ) + b"".join([*directory, *body])
    return magic + struct.pack("<Q", xxhash.xxh3_64_intdigest(tail)) + tail


def decode_flat(
    data: bytes | memoryview, magic: bytes
) -> tuple[int, dict[str, npt.NDArray[np.generic]]]:
    """Read a flat file; every flipped bit and every truncation is noticed.

    Parameters
    ----------
    data : bytes or memoryview
        The whole file. Nothing is allocated from a length that has not been checked against it.
    magic : bytes
        The eight bytes expected.

    Returns
    -------
    rows : int
        The header's row count.
    fields : dict of str to ndarray
        Read-only views of *data*, shape (n,) for one component, else (n, k). Fields of unknown
        dtype are left out.

    Raises
    ------
    PayloadError
        With the offset: too short, wrong magic, unknown major version, wrong length, wrong
        checksum, or a directory entry that points outside the file.
    """
    # (1) The header, then the checksum over everything after it: from here on the bytes are those
    # that were written, though not for certain by us.
    view = memoryview(data).cast("B")
    size = len(view)
    if size < _HEADER.size:
        raise PayloadError(
            f"{size} bytes, expected at least {_HEADER.size} for the header", offset=0
        )
    magic_read, checksum, major, _minor, start, file_bytes, count, entry_bytes, rows, _ = (
        _HEADER.unpack_from(view)
    )
    if magic_read != magic:
        raise PayloadError(f"magic {magic_read!r}, expected {magic!r}", offset=0)
    if major != MAJOR:
        raise PayloadError(f"format version {major}, expected {MAJOR}", offset=16)
    if file_bytes != size:
        raise PayloadError(f"{size} bytes, expected {file_bytes} by the header", offset=24)
    actual = xxhash.xxh3_64_intdigest(view[16:])
    if actual != checksum:
        raise PayloadError(f"checksum {actual:016x}, expected {checksum:016x}", offset=8)
    # (2) The directory lies within the file. Entries may be longer than ours: what a later minor
    # version adds at their ends is skipped.
    if count > MAX_FIELDS or entry_bytes < _ENTRY.size or start < _HEADER.size:
        raise PayloadError(
            f"{count} fields of {entry_bytes} bytes at {start}, expected at most {MAX_FIELDS} "
            f"of at least {_ENTRY.size} at {_HEADER.size} or later",
            offset=32,
        )
    if start + count * entry_bytes > size:
        raise PayloadError(f"a directory of {count} fields runs past the end at {size}", offset=32)
    # (3) The fields, as views. Invariant: a view is made only after its bytes are known to lie
    # within the file and to be as many as its rows take.
    fields: dict[str, npt.NDArray[np.generic]] = {}
    for number in range(count):
        at = start + number * entry_bytes
        raw_name, code, components, _, n, offset, length = _ENTRY.unpack_from(view, at)
        dtype = _DTYPES.get(code)
        if dtype is None:  # of a later version
            continue
        try:
            name = raw_name.rstrip(b"\0").decode("utf-8")
        except UnicodeDecodeError:
            raise PayloadError(f"field name {raw_name!r}, expected UTF-8", offset=at) from None
        if components < 1 or length != n * components * dtype.itemsize:
            raise PayloadError(
                f"field {name!r} has {length} bytes for {n} rows of {components} x {dtype.name}",
                offset=at,
            )
        if offset % _ALIGNMENT or offset > size or length > size - offset:
            raise PayloadError(
                f"field {name!r} lies at {offset} with {length} bytes, "
                f"expected a multiple of {_ALIGNMENT} within the file's {size} bytes",
                offset=at,
            )
        if name in fields:
            raise PayloadError(f"field {name!r} appears twice", offset=at)
        values = np.frombuffer(view[offset : offset + length], dtype=dtype)
        values.flags.writeable = False
        fields[name] = values if components == 1 else values.reshape(n, components)
    return rows, fields
