"""Bounds of every HTTP connection, whatever it asks for."""

from __future__ import annotations

from dataclasses import dataclass

from terraport_server.settings import Settings

__all__ = ["HttpLimits"]


@dataclass(frozen=True, slots=True)
class HttpLimits:
    """Bounds of every connection; see docs/topics/limits.md."""

    header_bytes: int
    body_bytes: int
    header_timeout_s: float
    keep_alive_s: float
    stall_timeout_s: float
    max_connections: int
    max_connections_per_ip: int

    @classmethod
    def of(cls, settings: Settings) -> HttpLimits:
        """Return the bounds that the settings name."""
        return cls(
            header_bytes=settings.http_header_bytes,
            body_bytes=settings.http_body_bytes,
            header_timeout_s=settings.http_header_timeout_s,
            keep_alive_s=settings.http_keep_alive_s,
            stall_timeout_s=settings.http_stall_timeout_s,
            max_connections=settings.max_connections,
            max_connections_per_ip=settings.max_connections_per_ip,
        )
