"""What a check of a scene found.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from terraport_store.errors import DamagedSceneError

__all__ = ["MAX_FINDINGS", "Finding", "Findings"]

MAX_FINDINGS: Final = 1000
"""More than anybody reads; a scene with every byte wrong must not fill the memory."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong, or looks wrong."""

    severity: Literal["error", "warning"]
    """An error breaks a MUST of the format; a warning does not."""
    code: str
    """Stable short name, for example ``"payload-hash"``."""
    message: str
    """What was found and what was expected, lower-case, no full stop."""
    file: str
    """Path relative to the scene directory."""
    segment: int | None = None
    offset: int | None = None
    """Byte offset in the file, where one is known."""

    def __str__(self) -> str:
        where = self.file if self.segment is None else f"{self.file}, segment {self.segment}"
        at = "" if self.offset is None else f" at byte {self.offset}"
        return f"{self.severity} {self.code}: {where}{at}: {self.message}"


class Findings:
    """Gathers findings, at most :data:`MAX_FINDINGS`."""

    def __init__(self) -> None:
        self.all: list[Finding] = []

    def error(
        self,
        code: str,
        file: str,
        message: str,
        *,
        segment: int | None = None,
        offset: int | None = None,
    ) -> None:
        """Add what breaks a MUST of the format; `code` is stable, for programs."""
        if len(self.all) < MAX_FINDINGS:
            self.all.append(Finding("error", code, message, file, segment, offset))

    def damaged(self, code: str, error: DamagedSceneError) -> None:
        """Add what an exception says."""
        self.error(code, error.file, error.what, offset=error.offset)
