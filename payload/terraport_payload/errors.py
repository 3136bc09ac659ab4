"""Errors of the payload codecs.

::

    ValueError
    └── PayloadError        bytes that are not a payload, or a mesh that no payload can carry

PURE: no I/O, no clock.
"""

from __future__ import annotations

__all__ = ["PayloadError"]


class PayloadError(ValueError):
    """Bytes that cannot be decoded, or a mesh that cannot be encoded.

    Parameters
    ----------
    what : str
        What was received and what was expected, lower-case, no full stop.
    offset : int, optional
        Byte offset in the payload at which it was noticed; None for a mesh.

    Examples
    --------
    >>> str(PayloadError("magic b'XXXX', expected b'glTF'", offset=0))
    "magic b'XXXX', expected b'glTF' (payload offset 0)"
    """

    def __init__(self, what: str, *, offset: int | None = None) -> None:
        super().__init__(what)
        self.what = what
        self.offset = offset

    def __str__(self) -> str:
        return self.what if self.offset is None else f"{self.what} (payload offset {self.offset})"
