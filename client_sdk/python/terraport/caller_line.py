"""Line of application code that made a call, for warnings issued later or on another thread."""

from __future__ import annotations

import inspect
import warnings
from dataclasses import dataclass
from types import FrameType
from typing import Any, Final, Self

__all__ = ["CallerLine"]

_SKIPPED: Final = ("terraport", "asyncio")
"""Packages that the search skips, as they are not application code."""


@dataclass(frozen=True, slots=True)
class CallerLine:
    """A line of code that warnings point at."""

    filename: str
    number: int
    scope: dict[str, Any]
    """Globals of its module: Python notes there which warnings it has shown for the line."""

    @classmethod
    def find(cls) -> Self:
        """Return the innermost line outside this package and asyncio, else the current line."""
        frame = first = inspect.currentframe()
        while frame is not None and _is_skipped(frame):
            frame = frame.f_back
        frame = frame or first
        assert frame is not None, "CPython has frames"
        return cls(frame.f_code.co_filename, frame.f_lineno, frame.f_globals)

    def warn(self, text: str, category: type[Warning]) -> None:
        """Issue a warning that points at the line."""
        registry = self.scope.setdefault("__warningregistry__", {})
        module = self.scope.get("__name__")
        warnings.warn_explicit(
            text, category, self.filename, self.number, module=module, registry=registry
        )


def _is_skipped(frame: FrameType) -> bool:
    return str(frame.f_globals.get("__name__")).partition(".")[0] in _SKIPPED
