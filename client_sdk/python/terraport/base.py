"""The base mesh of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from terraport.errors import ProtocolViolationError
from terraport_payload import AttributeScale, PayloadError, SegmentMesh, decode_segment

__all__ = ["BaseMesh"]


@dataclass(frozen=True, slots=True)
class BaseMesh:
    """The light mesh that is always there. Which faces a landing hides, the landing says."""

    version: str
    """Scene version; the hidden faces of a landing belong to it alone."""
    mesh: SegmentMesh
    """Scene frame; faces in the order in which :attr:`terraport.Landing.hidden_faces` has them."""

    def __repr__(self) -> str:
        """Say what it holds, not its arrays."""
        return f"<BaseMesh of version {self.version[:12]}: {self.mesh!r}>"

    @classmethod
    def of(cls, version: str, data: bytes, scales: Mapping[str, AttributeScale]) -> BaseMesh:
        """Decode ``base.tsg``, with the scales of the scene's attributes.

        Raises
        ------
        ProtocolViolationError
            It cannot be decoded.
        """
        try:
            return cls(version, decode_segment(data, scales=scales))
        except PayloadError as error:
            raise ProtocolViolationError(f"base mesh: {error}") from error
