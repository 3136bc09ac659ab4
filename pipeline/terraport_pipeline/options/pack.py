"""Options of the packing of a scene."""

from __future__ import annotations

from dataclasses import dataclass

from terraport_pipeline.errors import OptionError

__all__ = ["Options"]


@dataclass(frozen=True, slots=True)
class Options:
    """Name of the published scene."""

    name: str
    """The scene's name for people."""
    levels: int = 1
    """Payloads of each segment."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.name) <= 200:
            raise OptionError(f"name of {len(self.name)} characters; expected 1 to 200")
