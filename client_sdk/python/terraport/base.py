"""The base mesh of a scene, with the cover that says what of it to hide."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from terraport.cover import CoverCounters
from terraport.errors import ProtocolViolationError
from terraport_payload import Cover, PayloadError, SegmentMesh, decode_glb
from terraport_payload.types import Bool

__all__ = ["BaseMesh"]


@dataclass(frozen=True, slots=True)
class BaseMesh:
    """The light mesh that is always there. One per scene version; not thread-safe."""

    version: str
    """Scene version; segment ids in the cover belong to it alone."""
    mesh: SegmentMesh
    """B faces, scene frame."""
    cover: Cover
    """Segments over each face, as stored."""
    counters: CoverCounters
    """The incremental form of the cover; its state is whatever was shown last."""
    segment_count: int | None = None
    """Segments of the scene; None where all ids are segments, since there is one level."""

    def __repr__(self) -> str:
        """Say what it holds, not its arrays."""
        return f"<BaseMesh of version {self.version[:12]}: {self.mesh!r}, {self.cover!r}>"

    @classmethod
    def of(
        cls, version: str, glb: bytes, cover: bytes, segment_count: int | None = None
    ) -> BaseMesh:
        """Decode what the server gives as ``base.glb`` and ``base.cover``.

        Raises
        ------
        ProtocolViolationError
            One of them cannot be decoded, or they do not belong together.
        """
        try:
            mesh = decode_glb(glb)
            rows = Cover.from_bytes(cover, len(mesh.faces))
        except PayloadError as error:
            raise ProtocolViolationError(f"base mesh: {error}") from error
        return cls(version, mesh, rows, CoverCounters.of(rows), segment_count)

    def hidden_faces(self, loaded: Iterable[int]) -> Bool:
        """Return which faces must not be drawn while these segments are shown.

        Costs what changed since the last call, not the size of the mesh (but for the copy).

        Parameters
        ----------
        loaded : iterable of int
            Ids of all segments that are shown, each at one level, whichever.

        Returns
        -------
        ndarray of shape (B,), bool
            A copy. True iff at least one segment lies over the face and all of those are loaded.
        """
        segments = self.segment_count
        shown = loaded if segments is None else (row % segments for row in loaded)
        return self.counters.show(shown).copy()
