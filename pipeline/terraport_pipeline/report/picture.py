"""One picture of a report with the words that belong to it, and how large pictures are."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from terraport_payload.types import UInt8
from terraport_pipeline.engines.palettes import RAMP_STOPS
from terraport_pipeline.engines.pictures import encode_jpeg, reduced_jpeg

__all__ = ["Legend", "Picture", "PictureOptions", "picture_of", "preview_of"]

PREVIEW_WIDTH: Final = 640
"""Pixels: of a card in a list, sharp on dense screens."""

PREVIEW_QUALITY: Final = 78


@dataclass(frozen=True, slots=True)
class Legend:
    """Ends, unit and colours of a ramp, for the words under a picture."""

    low: float
    high: float
    label: str
    stops: tuple[str, ...] = RAMP_STOPS


@dataclass(frozen=True, slots=True)
class Picture:
    """One picture as JPEG, with title, alternative text, caption and legend."""

    key: str
    title: str
    alt: str
    """What it shows, for those who do not see it."""
    caption: str
    jpeg: bytes = field(repr=False)
    width: int
    height: int
    legend: Legend | None = None


@dataclass(frozen=True, slots=True)
class PictureOptions:
    """Pixels, rays per pixel and JPEG quality of the pictures."""

    width: int = 1280
    height: int = 720
    supersample: int = 2
    quality: int = 84
    """Quality of the JPEG files, 1..95."""


def picture_of(
    quality: int,
    key: str,
    title: str,
    alt: str,
    caption: str,
    image: UInt8,
    legend: Legend | None = None,
) -> Picture:
    """Make a picture of an image and its words."""
    data = encode_jpeg(image, quality)
    height, width = image.shape[:2]
    return Picture(key, title, alt, caption, data, width, height, legend)


def preview_of(picture: Picture) -> bytes:
    """Reduce a picture to what a list shows, as JPEG: some 40 KB."""
    return reduced_jpeg(picture.jpeg, PREVIEW_WIDTH, PREVIEW_QUALITY)
