"""What a session counts."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["SessionStats"]


@dataclass(frozen=True, slots=True)
class SessionStats:
    """What a session has done so far."""

    connections: int
    received_bytes: int
    """Bytes of all WebSocket messages, payload and headers."""
    payload_bytes: int
    """Payload bytes of whole segments that the server sent."""
    prefetched_bytes: int
    """Those of them that aims brought."""
    prefetch_used_bytes: int
    """Those of them that the next landing kept; the others came to nothing, or not yet."""
    aimed_landings: int
    """Landings that had an aim before them."""
    aim_hits: int
    """Those of them that had nothing left to load."""
    repeated_bytes: int
    """Payload bytes of segments that were in memory already; 0 with a right server."""
    rejected: int
    """Segments with a wrong hash, from the stream or the disk cache."""
    cache_bytes: int
    """Payload bytes in memory now."""
    pulled_bytes: int = 0
    """Bytes fetched over HTTP by a session that pulls: payload, and gaps between payloads."""
    pull_requests: int = 0
    """Requests that it took."""

    @property
    def aim_hit_rate(self) -> float | None:
        """Share of landings after an aim that had nothing left to load; None before the first."""
        return self.aim_hits / self.aimed_landings if self.aimed_landings else None
