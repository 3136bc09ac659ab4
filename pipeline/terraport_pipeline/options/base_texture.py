"""Options of the base mesh's image."""

from __future__ import annotations

from dataclasses import dataclass

from terraport_pipeline.errors import OptionError
from terraport_pipeline.options.texture import SIDES, ImageFormat

__all__ = ["Options"]


@dataclass(frozen=True, slots=True)
class Options:
    """How fine the base's image is."""

    side: int = 2048
    """Longest side, pixels."""
    quality: int = 85
    """Of JPEG and WebP; lowered where mesh and image would have too many bytes."""
    kind: ImageFormat = "jpeg"
    """Format of the image."""

    def __post_init__(self) -> None:
        if self.side not in SIDES:
            raise OptionError(f"base texture {self.side} pixels; expected {SIDES}")
