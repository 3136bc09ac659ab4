"""Segments over each base face; see :mod:`terraport_payload.cover`, where clients find it too.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from terraport_payload.cover import COVER_MAGIC, Cover

__all__ = ["COVER_MAGIC", "Cover"]
