"""Which faces of the base mesh the loaded segments hide.

The rule (``segmentation.md`` section 4): a base face is hidden **iff all segments over it are
loaded**, and a face over which no segment lies is never hidden. The offline build stores, for each
base face, the ids of the segments over it (CSR). Here each face has one counter, *the number of
segments over it that are not loaded*, so that a landing costs only the faces under the segments
that change.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
import numpy.typing as npt

from terraport.errors import ProtocolViolationError, UsageError
from terraport_payload import Cover
from terraport_payload.types import Bool, Int64

__all__ = ["CoverCounters"]

_COUNTER: Final = np.int32
"""Wide enough for any count: a face can have no more segments over it than the scene has."""

_MAX_SEGMENTS: Final = 1 << 25
"""More than an index of 1 GiB has rows: nothing is allocated by an id beyond it."""


class CoverCounters:
    """Incremental hidden-face mask of one base mesh.

    B base faces, N entries in all. Not thread-safe; owned by one session.

    Parameters
    ----------
    offsets : ndarray of shape (B + 1,)
        Start of each face's list in `segments`; first 0, never falling, last N.
    segments : ndarray of shape (N,)
        Segment ids, ascending and unique within one face.

    Raises
    ------
    ProtocolViolationError
        The arrays are not a CSR of that form.

    Notes
    -----
    Adding or removing a set of segments costs O(entries of those segments); building costs O(N log
    N) once, for the inverse lists.

    Examples
    --------
    Three faces: under segment 0; under 0 and 1; under none.

    >>> cover = CoverCounters(np.array([0, 1, 3, 3]), np.array([0, 0, 1]))
    >>> cover.add([0]); cover.hidden.tolist()
    [True, False, False]
    >>> cover.add([1]); cover.hidden.tolist()
    [True, True, False]
    >>> cover.remove([0]); cover.hidden.tolist()
    [False, False, False]
    """

    __slots__ = ("_faces", "_hidden", "_loaded", "_missing", "_starts", "_total")

    @classmethod
    def of(cls, cover: Cover) -> CoverCounters:
        """Return counters with nothing loaded, for a cover as the scene stores it."""
        return cls(cover.offsets, cover.segments)

    def __init__(self, offsets: npt.ArrayLike, segments: npt.ArrayLike) -> None:
        starts, ids = _validate_csr(offsets, segments)
        face_count = len(starts) - 1
        self._total = np.diff(starts).astype(_COUNTER)
        self._missing = self._total.copy()
        self._hidden = np.zeros(face_count, dtype=np.bool_)
        self._loaded: set[int] = set()
        # Inverse CSR: the faces under each segment, in face order.
        order = np.argsort(ids, kind="stable")
        self._faces = np.repeat(np.arange(face_count, dtype=np.int64), np.diff(starts))[order]
        segment_count = int(ids.max()) + 1 if len(ids) else 0
        self._starts = np.concatenate(
            ([0], np.cumsum(np.bincount(ids, minlength=segment_count)))
        ).astype(np.int64)

    @property
    def face_count(self) -> int:
        """Number of base faces B."""
        return len(self._total)

    @property
    def loaded(self) -> frozenset[int]:
        """Ids that count as loaded at present."""
        return frozenset(self._loaded)

    @property
    def hidden(self) -> Bool:
        """(B,) bool, True where the face must not be drawn; a read-only, live view."""
        view = self._hidden.view()
        view.flags.writeable = False
        return view

    @property
    def rim(self) -> Bool:
        """(B,) bool, True for drawn faces over which some but not all segments are loaded; a copy.

        Only there can base and detail overlap.
        """
        return (self._missing > 0) & (self._missing < self._total)

    def add(self, segments: Iterable[int]) -> None:
        """Count segments as loaded.

        Parameters
        ----------
        segments : iterable of int
            Ids; those loaded already, and repeats, change nothing. An id that lies over no face is
            remembered but hides nothing.

        Raises
        ------
        UsageError
            An id is negative.
        """
        new = _clean_ids(segments) - self._loaded
        self._loaded |= new
        self._change(new, -1)

    def remove(self, segments: Iterable[int]) -> None:
        """Count segments as no longer loaded; ids that are not loaded change nothing."""
        gone = _clean_ids(segments) & self._loaded
        self._loaded -= gone
        self._change(gone, +1)

    def show(self, segments: Iterable[int]) -> Bool:
        """Make exactly these segments the loaded ones: one swap of a landing.

        Returns
        -------
        ndarray of shape (B,), bool
            :attr:`hidden` afterwards.
        """
        wanted = _clean_ids(segments)
        self.remove(self._loaded - wanted)
        self.add(wanted)
        return self.hidden

    def _change(self, segments: set[int], step: int) -> None:
        faces = self._faces_under(segments)
        if not len(faces):
            return
        np.add.at(self._missing, faces, _COUNTER(step))
        # Only faces with at least one segment over them are ever in `faces`: total > 0 holds for
        # each.
        self._hidden[faces] = self._missing[faces] == 0

    def _faces_under(self, segments: set[int]) -> Int64:
        segment_count = len(self._starts) - 1
        runs = [
            self._faces[self._starts[segment] : self._starts[segment + 1]]
            for segment in segments
            if segment < segment_count
        ]
        return np.concatenate(runs) if runs else np.zeros(0, dtype=np.int64)


def _clean_ids(segments: Iterable[int]) -> set[int]:
    ids = {int(segment) for segment in segments}
    if ids and min(ids) < 0:
        raise UsageError(f"segment id {min(ids)} is negative, expected 0 or more")
    return ids


def _validate_csr(offsets: npt.ArrayLike, segments: npt.ArrayLike) -> tuple[Int64, Int64]:
    """Return both arrays as int64, or raise ProtocolViolationError saying which rule they break."""
    starts = np.asarray(offsets, dtype=np.int64)
    ids = np.asarray(segments, dtype=np.int64)
    if starts.ndim != 1 or len(starts) < 1 or ids.ndim != 1:
        raise ProtocolViolationError(
            f"cover has shapes {starts.shape} and {ids.shape}, expected (B + 1,) and (N,)"
        )
    if starts[0] != 0 or starts[-1] != len(ids) or np.any(np.diff(starts) < 0):
        raise ProtocolViolationError(
            f"cover offsets run {starts[0]}..{starts[-1]}, expected 0..{len(ids)}, never falling"
        )
    if len(ids) and ids.min() < 0:
        raise ProtocolViolationError(f"cover names segment {ids.min()}, expected 0 or more")
    if len(ids) and ids.max() >= _MAX_SEGMENTS:
        raise ProtocolViolationError(
            f"cover names segment {ids.max()}, expected below {_MAX_SEGMENTS}"
        )
    rising = np.diff(ids) > 0
    borders = starts[1:-1]
    rising[borders[(borders > 0) & (borders < len(ids))] - 1] = True
    if not rising.all():
        entry = int(np.argmin(rising))
        raise ProtocolViolationError(
            f"cover entries {entry} and {entry + 1} name segments {ids[entry]} and "
            f"{ids[entry + 1]} of one face, expected them ascending"
        )
    return starts, ids
