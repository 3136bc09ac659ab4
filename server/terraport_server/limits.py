"""Fixed limits of the service: what no operator needs to set.

Everything that an operator sets is in :mod:`terraport_server.settings`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any, Final, Self

from terraport_server.groups.state import GroupLimits
from terraport_server.session.interface import SessionLimits
from terraport_server.settings import Settings

__all__ = ["DEFAULT_LIMITS", "Limits"]


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of one process; tests and benchmarks change some."""

    session: SessionLimits = field(default_factory=SessionLimits)
    """Limits of one client; of some the values come from the settings."""
    groups: GroupLimits = field(default_factory=GroupLimits)

    close_timeout_s: float = 5.0
    """Time in which a closing client may read what is left."""
    max_pending_actions: int = 64
    """Messages waiting for one client; above it the service stops reading from that client."""
    notsent_lowat_bytes: int = 256 << 10
    """TCP_NOTSENT_LOWAT: unsent bytes in the kernel, which no newer landing can replace."""

    pick_timeout_s: float = 2.0
    pick_max_segments: int = 64
    """Segments that one pick may decode."""
    pick_cache_bytes: int = 64 << 20
    """Decoded segments kept for picks, of all clients together."""
    pick_threads: int = 1
    max_strokes_per_s: float = 2.0
    """Strokes that one token may paint or remove, averaged over 10 s."""

    scene_poll_s: float = 1.0
    """Interval at which scene.json files are checked for newer versions."""
    object_poll_s: float = 10.0
    """The same in object storage, where a check costs a list and two heads per scene."""
    object_memory_bytes: int = 64 << 20
    """Payloads kept in memory while the cache on disk takes none."""
    object_requests: int = 16
    """Concurrent requests for one scene, and as many ahead of need."""
    object_read_ahead_bytes: int = 8 << 20
    """Bytes fetched ahead for one landing."""
    object_timeout_s: float = 20.0
    """Longest time for a request with its retries."""

    token_leeway_s: float = 30.0
    """Clock difference allowed between this machine and the one that signs tokens."""
    access_check_s: float = 1.0
    """Interval at which files of tokens and keys, and the tokens of sessions, are checked."""

    def with_changes(self, **changes: Any) -> Self:
        """Return limits with some changed, those of sessions and groups among them.

        Raises
        ------
        TypeError
            If no limit has this name.
        """
        session = _take(changes, SessionLimits)
        groups = _take(changes, GroupLimits)
        return replace(
            self,
            session=replace(self.session, **session),
            groups=replace(self.groups, **groups),
            **changes,
        )

    def of_session(self, settings: Settings, server: str) -> SessionLimits:
        """Return the limits of one client.

        Parameters
        ----------
        settings
            The operator's.
        server
            Name and version of the service, for ``welcome``.
        """
        return replace(
            self.session,
            server=server,
            max_radius_m=settings.max_radius_m,
            max_messages_per_s=settings.max_messages_per_s,
            max_credit_bytes=settings.max_credit_bytes,
            idle_timeout_s=settings.idle_timeout_s,
            groups=settings.groups_served,
        )


DEFAULT_LIMITS: Final = Limits()


def _take(changes: dict[str, Any], kind: type[Any]) -> dict[str, Any]:
    """Remove and return the changes of one kind of limits."""
    names = {one.name for one in fields(kind)}
    return {name: changes.pop(name) for name in list(changes) if name in names}
