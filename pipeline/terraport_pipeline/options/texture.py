"""Options of textures: what they are made of and how fine they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal

from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import Option, check_options

__all__ = ["SIDES", "ImageFormat", "Options", "Source"]

Source = Literal["photos", "vertex", "mesh"]

ImageFormat = Literal["jpeg", "webp", "png", "ktx2"]

SIDES: Final = (256, 512, 1024, 2048, 4096)
"""Longest sides that an image may have, pixels."""


@dataclass(frozen=True, slots=True)
class Options:
    """What textures are made of and how fine they are."""

    source: Annotated[Source, Option(flags=("--texture-from",))] = "photos"
    """What textures are drawn from. mesh: the images of a mesh that was textured elsewhere, which
    is the default of such a mesh. vertex draws the colours of the cloud into images, to compare and
    for loaders that know no vertex colours."""
    texel_m: Annotated[
        float | None,
        Option(
            flags=("--texel-size",),
            least=1e-4,
            most=1e3,
            unit="m",
            unset="as fine as the photos; of vertex colours two texels an edge",
        ),
    ] = None
    """Metres of surface that one texel is wide. Twice as many take a quarter of the memory. Never
    finer than a photo's pixel, nor, beside photos, than two texels an edge where no photo shows
    the ground; coarser where a segment would not fit."""
    kind: Annotated[ImageFormat, Option(flags=("--texture-format",))] = "jpeg"
    """How images are packed. jpeg: every loader reads it. webp: a quarter smaller. png: without
    loss. ktx2: an eighth on the GPU, encoded by Node."""
    quality: Annotated[int, Option(flags=("--texture-quality",), least=1, most=100)] = 85
    """Quality of jpeg, webp and ktx2: higher is larger and truer."""
    max_side: int = 2048
    """Longest side of a segment's image."""
    base_side: int = 2048
    """Longest side of the base's image; ``--base-texture``, which counts without textures, too."""

    def __post_init__(self) -> None:
        check_options(self)
        if self.max_side not in SIDES[:-1] or self.base_side not in SIDES:
            raise OptionError(
                f"texture sides {self.max_side} (segments) and {self.base_side} (base); expected "
                "powers of two from 256 to 2048 and to 4096"
            )
