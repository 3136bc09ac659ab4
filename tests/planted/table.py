"""The faults of ``faults.toml``."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

__all__ = ["FAULTS", "Fault"]


@dataclass(frozen=True, slots=True)
class Fault:
    """One edit of one file."""

    name: str
    path: str
    old: str
    """Occurs exactly once in the file."""
    new: str
    what: str


_TEXT: Final = Path(__file__).with_name("faults.toml").read_text(encoding="utf-8")
FAULTS: Final = tuple(Fault(name, **fields) for name, fields in tomllib.loads(_TEXT).items())
