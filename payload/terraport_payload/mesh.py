"""What one payload holds, as plain arrays.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from terraport_payload.texture import Texture
from terraport_payload.types import Float32, UInt8, UInt16, UInt32

__all__ = ["SegmentMesh"]


@dataclass(frozen=True, slots=True)
class SegmentMesh:
    """The geometry of one segment (or of the base mesh) in the scene frame.

    V vertices, F faces. Positions are absolute (about the scene's origin, not the segment's).
    """

    positions: Float32
    """(V, 3) metres, scene frame: right-handed, Y up."""
    faces: UInt32
    """(F, 3) vertex indices, counter-clockwise seen from outside."""
    normals: Float32
    """(V, 3) unit."""
    colours: UInt8 | None = None
    """(V, 3) sRGB, 0..255."""
    region_ids: UInt16 | None = None
    """(V,) region of every face that uses the vertex (vertices on region borders are split)."""
    attributes: dict[str, Float32] = field(default_factory=dict)
    """(V,) by the survey's attribute name."""
    uvs: Float32 | None = None
    """(V, 2) texture coordinates 0..1 from the image's upper left; None without a texture."""
    texture: Texture | None = None
    """Instead of vertex colours."""

    def __repr__(self) -> str:
        """Say what it holds, not its arrays: a mesh is printed by people who look around."""
        held = [f"{len(self.faces):,} faces", f"{len(self.positions):,} vertices"]
        if len(self.positions):
            size_m = self.positions.max(axis=0) - self.positions.min(axis=0)
            held.append(" x ".join(f"{side:.4g}" for side in size_m) + " m")
        held += [name for name in ("colours", "region_ids") if getattr(self, name) is not None]
        held += sorted(self.attributes)
        if self.texture is not None:
            held.append(repr(self.texture))
        return f"<SegmentMesh {', '.join(held)}>"
