"""One streamed segment, as its user sees it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from terraport.cache import CachedSegment
from terraport.errors import TerraportError
from terraport.mesh import to_trimesh
from terraport.payloads import Scales
from terraport_payload import SegmentMesh, decode_segment

if TYPE_CHECKING:
    import trimesh

__all__ = ["Segment"]


@dataclass(frozen=True, slots=True)
class Segment:
    """A payload that has the right hash, not decoded yet. Immutable; any thread may use it."""

    entry: CachedSegment
    source: str
    """``"stream"``: sent for this landing; ``"memory"``, ``"disk"``: held before."""
    scales: Scales
    """Of the scene version's attributes, as its manifest has them."""

    def __repr__(self) -> str:
        """Say what the index says of it, and where it came from."""
        size = f"{self.faces:,} faces, {self.vertices:,} vertices, {len(self.payload):,} bytes"
        return f"<Segment {self.id}: {size}, from {self.source}>"

    @property
    def id(self) -> int:
        """Segment id, unique in one scene version."""
        return self.entry.facts.segment

    @property
    def payload(self) -> bytes:
        """The bytes as the server sent them: segment format 2 (``spec/segment-format.md``).

        :func:`terraport.write_glb` writes :meth:`arrays` as a file that viewers open.
        """
        return self.entry.payload

    @property
    def faces(self) -> int:
        """Number of triangles."""
        return self.entry.facts.faces

    @property
    def vertices(self) -> int:
        """Number of vertices."""
        return self.entry.facts.vertices

    @property
    def bounds(self) -> tuple[float, float, float, float, float, float]:
        """Min x, y, z, max x, y, z in metres, scene frame."""
        return self.entry.facts.bounds

    @property
    def xxh3(self) -> int:
        """xxh3-64 of the payload."""
        return self.entry.facts.xxh3

    def arrays(self) -> SegmentMesh:
        """Decode to NumPy arrays; every call decodes anew (about 2 ms for 10 k faces).

        Raises
        ------
        terraport_payload.PayloadError
            The payload is not a whole segment.
        HttpError
            The scene's manifest, which says what attributes mean, could not be fetched when the
            connection was made.
        """
        if isinstance(self.scales, TerraportError):
            raise self.scales
        return decode_segment(self.entry.payload, scales=self.scales)

    def to_trimesh(self) -> trimesh.Trimesh:
        """Decode to a trimesh; attributes in ``vertex_attributes``.

        Raises what :meth:`arrays` raises.

        Raises
        ------
        MissingExtraError
            trimesh is not installed.
        """
        return to_trimesh(self.arrays())
