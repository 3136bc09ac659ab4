"""Rays that are traced once for several pictures of one view.

The pictures of the whole scene (its colours, its regions, its segments, an attribute) are drawn by
one camera from one mesh: every one of them asks for the same rays, and for the same rays towards
the sun from where those met the ground.
"""

from __future__ import annotations

from threading import Lock
from typing import Final

import numpy as np
import numpy.typing as npt
from xxhash import xxh3_128_digest

from terraport_pipeline.engines.rays import Hits, RayScene

__all__ = ["TracedRays"]

MAX_RAYS: Final = 24_000_000
"""Rays whose hits are kept: 16 bytes each. What comes after is traced and forgotten."""


class TracedRays(RayScene):
    """A mesh that remembers which rays it has answered.

    Parameters
    ----------
    traced : RayScene
        Answers what is asked for the first time. It stays as it is.
    """

    def __init__(self, traced: RayScene) -> None:
        # Not built again: this stands before a mesh that is there.
        self.face_count = traced.face_count
        self._traced = traced
        self._hits_of: dict[bytes, Hits] = {}
        self._kept = 0
        self._lock = Lock()

    def intersect(self, origins: npt.ArrayLike, directions: npt.ArrayLike) -> Hits:
        """Find the first face that each ray meets; see :meth:`RayScene.intersect`.

        May be called from several threads at once.
        """
        starts = np.ascontiguousarray(origins, dtype=np.float32)
        headings = np.ascontiguousarray(directions, dtype=np.float32)
        key = xxh3_128_digest(starts.data) + xxh3_128_digest(headings.data)
        hits = self._hits_of.get(key)
        if hits is None:
            hits = self._traced.intersect(starts, headings)
            with self._lock:
                if self._kept + len(hits.t) <= MAX_RAYS:
                    self._hits_of[key] = hits
                    self._kept += len(hits.t)
        return hits
