"""Options of photos: where they are and where they were taken."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final

from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import COMMON, OFFSET, Option
from terraport_pipeline.options import texture

__all__ = ["Texturing"]

_NOT_PHOTOS: Final = {"vertex": "vertex colours", "mesh": "the mesh"}
"""What textures are made of without photos, by ``--texture-from``."""


@dataclass(frozen=True, slots=True)
class Texturing:
    """What a build is asked for in the way of textures."""

    options: texture.Options = field(default_factory=texture.Options)
    photos: Annotated[Path | None, Option(heading=COMMON)] = None
    """Folder of the survey's photos, or of the project that aligned them: the scene gets textures
    from them."""
    cameras: Annotated[
        Path | None, Option(heading=COMMON, unset="looked for in the photos' folder and above it")
    ] = None
    """Where the photos were taken: file or project folder of COLMAP, OpenSfM, OpenDroneMap, Pix4D,
    Metashape, RealityCapture, ContextCapture, VisualSFM or Bundler."""
    camera_offset: Annotated[
        tuple[float, float, float] | None,
        Option(notation=OFFSET, unset="found where the cameras' files state it"),
    ] = None
    """Metres east, north and up to add to the cameras' coordinates."""

    def __post_init__(self) -> None:
        if self.options.source != "photos" and (self.photos or self.cameras):
            raise OptionError(
                f"photos for textures from {_NOT_PHOTOS[self.options.source]}; expected one or the "
                f"other: leave out --photos, or --texture-from {self.options.source}"
            )
        if self.options.source == "photos" and self.photos is None:
            raise OptionError(
                "options of cameras or textures without photos; expected the folder of the photos "
                "with --photos, or --texture-from vertex; of a mesh with textures of its own "
                "--texture-from mesh"
            )
