"""Where a scene's colour comes from, in words and as data. PURE: no I/O.

``has_colour`` of a manifest alone does not say it: it is false in a textured scene, too, because
textures stand in the place of vertex colours (``spec/scene-format.md``, section 4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from terraport_store import Manifest

__all__ = ["SceneColour"]


@dataclass(frozen=True, slots=True)
class SceneColour:
    """Whether textures or vertex colours paint a scene, and how many segments of it."""

    source: Literal["photos", "points", "mesh"] | None
    """None: the ground is grey."""
    textured_segments: int
    """Segments whose colour is an image; the others have vertex colours, or none."""
    segments: int

    @classmethod
    def of(cls, manifest: Manifest) -> SceneColour:
        """Derive it from what a manifest says of textures and attributes."""
        textures, segments = manifest.textures, manifest.counts.segments
        if textures is None:
            return cls("points" if manifest.has_colour else None, 0, segments)
        source: Literal["photos", "points", "mesh"] = (
            "points" if textures.source == "vertex" else textures.source
        )
        return cls(source, textures.segments, segments)

    def __str__(self) -> str:
        """Say it in one line.

        Examples
        --------
        >>> str(SceneColour("photos", 24, 24))
        'from the photos, as textures'
        >>> str(SceneColour("photos", 23, 24))
        'from the photos, as textures on 23 of 24 segments; the others as the points have it'
        >>> str(SceneColour("mesh", 24, 24))
        'from the images of the mesh, as textures'
        >>> str(SceneColour("points", 0, 24))
        'from the points'
        >>> str(SceneColour(None, 0, 24))
        'none in the survey: everything is grey'
        """
        if self.source is None:
            return "none in the survey: everything is grey"
        text = f"from the {'images of the mesh' if self.source == 'mesh' else self.source}"
        if not self.textured_segments:
            return text
        if self.textured_segments == self.segments:
            return f"{text}, as textures"
        return (
            f"{text}, as textures on {self.textured_segments:,} of {self.segments:,} segments; "
            f"the others as the {'mesh has' if self.source == 'mesh' else 'points have'} it"
        )
