"""What the sampled points hold beside their coordinates: colours and columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.sample.sampled_points import BLOCK_ROWS

__all__ = ["Colours", "Column", "colours_of", "column_of"]

_MOST_CODES: Final = 32
"""Whole numbers with at most so many values are counted value by value."""


@dataclass(frozen=True, slots=True)
class Column:
    """An attribute, by the points that were read."""

    name: str
    type: str
    low: float | None
    """Least value; None where all are missing."""
    high: float | None
    missing: int
    """Points without a value."""
    values: dict[str, int] | None
    """Points by value, of codes."""


@dataclass(frozen=True, slots=True)
class Colours:
    """Colours, by the points that were read."""

    depths: tuple[str, ...]
    """Colour depths of the files: ``unit`` (0..1), ``eight`` or ``sixteen`` bits, or the range."""
    distinct: int
    """Different colours, as 8 bits each of red, green and blue."""
    black: int
    """Points that are black: without colour, as a rule."""


def colours_of(folder: Path, depths: Sequence[str]) -> Colours | None:
    """Count the colours of a folder's points; None where they have none."""
    path = folder / "colours.npy"
    if not path.exists():
        return None
    distinct: AnyArray = np.zeros(0, np.uint32)
    black = 0
    for _, block in NpyReader(path).blocks(BLOCK_ROWS):
        packed = block.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
        black += int((packed == 0).sum())
        distinct = np.union1d(distinct, packed)
    return Colours(tuple(depths), len(distinct), black)


def column_of(name: str, reader: NpyReader) -> Column:
    """Look through an attribute: its range, what is missing, its codes."""
    low, high, missing = np.inf, -np.inf, 0
    is_float = reader.dtype.kind == "f"
    codes: dict[Any, int] | None = {}
    for _, block in reader.blocks(BLOCK_ROWS):
        good = block[np.isfinite(block)] if is_float else block
        missing += len(block) - len(good)
        if len(good):
            low, high = min(low, float(good.min())), max(high, float(good.max()))
        if codes is not None:
            values, counts = np.unique(good, return_counts=True)
            if is_float and (values != np.rint(values)).any():
                codes = None
                continue
            for value, count in zip(
                values[: _MOST_CODES + 1].tolist(), counts.tolist(), strict=False
            ):
                codes[value] = codes.get(value, 0) + count
            if len(codes) > _MOST_CODES:
                codes = None
    has_values = low <= high
    return Column(
        name,
        reader.dtype.name,
        low if has_values else None,
        high if has_values else None,
        missing,
        None if codes is None else {f"{key:g}": codes[key] for key in sorted(codes)},
    )
