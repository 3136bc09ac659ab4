"""What one payload holds, as plain arrays.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from terraport_payload.texture import Texture

__all__ = ["SegmentMesh"]


@dataclass(frozen=True, slots=True)
class SegmentMesh:
    """The geometry of one segment (or of the base mesh) in the scene frame.

    V vertices, F faces. Positions are absolute (about the scene's origin, not the segment's).
    """

    positions: npt.NDArray[np.float32]
    """(V, 3) metres, scene frame: right-handed, Y up."""
    faces: npt.NDArray[np.uint32]
    """(F, 3) vertex indices, counter-clockwise seen from outside."""
    normals: npt.NDArray[np.float32]
    """(V, 3) unit."""
    colours: npt.NDArray[np.uint8] | None = None
    """(V, 3) sRGB, 0..255."""
    region_ids: npt.NDArray[np.uint16] | None = None
    """(V,) region of every face that uses the vertex (vertices on region borders are split)."""
    attributes: dict[str, npt.NDArray[np.float32]] = field(default_factory=dict)
    """(V,) by the survey's attribute name."""
    uvs: npt.NDArray[np.float32] | None = None
    """(V, 2) texture coordinates 0..1 from the image's upper left; None without a texture."""
    texture: Texture | None = None
    """Instead of vertex colours."""
