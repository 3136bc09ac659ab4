"""Find the base faces that are hidden when a set of segments is shown.

A base face is hidden where at least one segment lies over it, and all that do are shown.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import gzip

import numpy as np

from terraport_payload.cover import Cover
from terraport_payload.types import AnyInt, Bool, Int64

__all__ = ["HiddenFaces"]


class HiddenFaces:
    """Index that answers which base faces are hidden.

    Parameters
    ----------
    cover : Cover
        Segments over each base face.
    segment_count : int
        Segments of the scene.

    Examples
    --------
    >>> cover = Cover(np.array([0, 2, 3, 3], np.uint32), np.array([0, 1, 1], np.uint32))
    >>> hidden = HiddenFaces(cover, segment_count=2)
    >>> hidden.of(np.array([1])).tolist(), hidden.of(np.array([0, 1])).tolist()
    ([False, True, False], [True, True, False])
    """

    def __init__(self, cover: Cover, segment_count: int) -> None:
        self._rows = np.diff(cover.offsets).astype(np.uint32)
        """(B,) segments over each base face."""
        faces = np.repeat(np.arange(cover.base_faces, dtype=np.uint32), self._rows)
        order = np.argsort(cover.segments, kind="stable")
        self._faces = faces[order]
        """Base faces under segment 0, then those under segment 1, and so on."""
        self._starts: Int64 = np.searchsorted(
            cover.segments, np.arange(segment_count + 1), sorter=order
        )

    @property
    def base_faces(self) -> int:
        """Faces of the base mesh, B."""
        return len(self._rows)

    def of(self, segments: AnyInt) -> Bool:
        """Return for each base face whether it is hidden.

        Parameters
        ----------
        segments : ndarray of shape (S,), int
            Numbers of the segments that are shown, each once.

        Returns
        -------
        ndarray of shape (B,), bool
        """
        starts, ends = self._starts[segments], self._starts[np.asarray(segments) + 1]
        lengths = ends - starts
        # All faces under the segments: a range of `_faces` for each.
        ahead = np.cumsum(lengths) - lengths
        places = np.arange(int(lengths.sum())) + np.repeat(starts - ahead, lengths)
        counts = np.bincount(self._faces[places], minlength=self.base_faces)
        hidden: Bool = (counts == self._rows) & (self._rows > 0)
        return hidden

    def packed(self, segments: AnyInt) -> bytes:
        """Return :meth:`of` as bits, the lowest first, in a gzip stream."""
        bits = np.packbits(self.of(segments), bitorder="little")
        return gzip.compress(bits.tobytes(), 6, mtime=0)
