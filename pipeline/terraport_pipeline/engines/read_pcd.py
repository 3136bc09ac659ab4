"""PCD (ascii, binary, binary_compressed) by pypcd4.

Format: Point Cloud Library, "The PCD file format", version 0.7. Sizes are checked against the file
before pypcd4 allocates anything. Padding fields (``_``) are left out; the viewpoint is ignored
(PCL stores coordinates with it applied).
"""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pydantic
from pypcd4.pypcd4 import Encoding, MetaData, PointCloud

from terraport_pipeline.engines.raw_survey import (
    Advance,
    RawSurvey,
    find_colours,
    thinning_rows,
    to_eight_bits,
)
from terraport_pipeline.errors import ReadError
from terraport_pipeline.model import UInt8

__all__ = ["read_pcd"]

_MAX_HEADER_BYTES: Final = 1 << 14

_PADDING: Final = "#$%&~~"
"""pypcd4's own name for fields that the file calls ``_``."""

_PACKED: Final = ("rgb", "rgba")
"""Fields that hold 0x00RRGGBB in 32 bits, whatever type they claim."""

_CUT: Final = "it is cut off: copy or export it again"


def read_pcd(path: Path, *, advance: Advance, max_points: int | None = None) -> RawSurvey:
    """Read a PCD file.

    Parameters
    ----------
    path : pathlib.Path
    advance : callable
        Told of progress: once, pypcd4 reads in one go.
    max_points : int, optional
        Thin to this many points (after reading).

    Raises
    ------
    ReadError
        When the header is wrong, x, y or z is missing, or the data is cut off; names the byte.
    """
    meta, start = _read_header(path)
    if meta.points == 0:
        raise ReadError(path, "the header says 0 points", "export the survey again")
    single = {name for name, count in zip(meta.fields, meta.count, strict=True) if count == 1}
    missing = [axis for axis in "xyz" if axis not in single]
    if missing:
        fields = ", ".join(name for name in meta.fields if not name.startswith(_PADDING))
        raise ReadError(
            path,
            f"there is no field {', '.join(missing)}; the fields are {fields}",
            "export the survey with coordinates named x, y, z",
        )
    _check_size(path, meta, start)
    try:
        table = PointCloud.from_path(path).pc_data
    except (ValueError, TypeError, LookupError, RuntimeError, OSError, struct.error) as error:
        raise ReadError(
            path,
            f"the points cannot be read ({' '.join(str(error).split())[:160]})",
            "the file is cut off or damaged: copy or export it again",
            f"byte {start:,}",
        ) from error
    table = np.atleast_1d(table)
    if len(table) < meta.points:
        raise ReadError(path, f"the file ends after {len(table):,} of {meta.points:,} points", _CUT)
    rows = thinning_rows(len(table), max_points)
    advance(len(table), len(table))
    return _assemble(table if rows is None else table[rows])


def _read_header(path: Path) -> tuple[Any, int]:
    with path.open("rb") as file:
        head = file.read(_MAX_HEADER_BYTES)
    match = re.search(rb"^DATA[ \t]+\S+[ \t]*\r?\n", head, re.MULTILINE)
    if match is None:
        raise ReadError(
            path,
            f"no DATA line within the first {len(head):,} bytes",
            "the file is cut off or no PCD: export the survey again",
        )
    lines = head[: match.end()].decode("latin-1").splitlines()
    try:
        meta = MetaData.parse_header([line.strip() for line in lines if line.strip()])
    except (pydantic.ValidationError, ValueError, IndexError) as error:
        reason = " ".join(str(error).split())[:160]
        raise ReadError(
            path, f"the PCD header is wrong ({reason})", "export the survey again"
        ) from error
    if not len(meta.fields) == len(meta.size) == len(meta.type) == len(meta.count):
        raise ReadError(
            path,
            f"FIELDS, SIZE, TYPE and COUNT have {len(meta.fields)}, {len(meta.size)}, "
            f"{len(meta.type)} and {len(meta.count)} entries, expected the same number",
            "export the survey again",
        )
    return meta, match.end()


def _check_size(path: Path, meta: Any, start: int) -> None:
    size = path.stat().st_size
    length = sum(s * c for s, c in zip(meta.size, meta.count, strict=True))
    if meta.data == Encoding.ASCII:
        need = meta.points * 2 * sum(meta.count) - 1
        have = size - start
    elif meta.data == Encoding.BINARY:
        need, have = meta.points * length, size - start
    else:
        with path.open("rb") as file:
            file.seek(start)
            sizes = file.read(8)
        packed, whole = struct.unpack("<II", sizes) if len(sizes) == 8 else (0, 0)
        if whole != meta.points * length and len(sizes) == 8:
            raise ReadError(
                path,
                f"the compressed data holds {whole:,} bytes, expected {meta.points * length:,}",
                "the header is damaged: export the survey again",
                f"byte {start:,}",
            )
        need, have = 8 + packed, size - start
    if have < need:
        whole_points = have // length if meta.data == Encoding.BINARY else None
        told = (
            f"the file ends after {whole_points:,} of {meta.points:,} points"
            if whole_points is not None
            else f"{have:,} bytes of points, expected at least {need:,}"
        )
        raise ReadError(path, told, _CUT, f"byte {size:,}")


def _assemble(table: npt.NDArray[Any]) -> RawSurvey:
    names = [name for name in table.dtype.names or () if not name.startswith(_PADDING)]
    points = np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)
    used = {"x", "y", "z"}
    packed = next((name for name in names if name.lower() in _PACKED), None)
    triple = find_colours(names)
    colours: UInt8 | None = None
    warnings: tuple[str, ...] = ()
    if packed is not None and table.dtype[packed].itemsize == 4:
        bits = np.ascontiguousarray(table[packed]).view(np.uint32)
        parts = np.stack([bits >> 16, bits >> 8, bits], axis=1) & 0xFF
        colours, warnings = to_eight_bits(parts.astype(np.uint8), where=packed)
        used.add(packed)
    elif triple is not None:
        parts = np.stack([table[name] for name in triple], axis=1)
        colours, warnings = to_eight_bits(parts, where=", ".join(triple))
        used |= set(triple)
    attributes = {name: np.ascontiguousarray(table[name]) for name in names if name not in used}
    return RawSurvey(points, colours, attributes, None, warnings)
