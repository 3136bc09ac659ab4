"""Metrics and log lines of one session."""

# ruff: noqa: D102 - most methods are documented in Observer
from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from time import monotonic

from terraport_server.client_key import client_key
from terraport_server.logging import OncePerMinute, log
from terraport_server.metrics import Metrics
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.session.interface import Observer
from terraport_wire import Error, ErrorCode

__all__ = ["SessionLog", "note_error"]


class SessionLog(Observer):
    """Observer of one session that writes metrics and log lines.

    Parameters
    ----------
    metrics
        Counters of the service.
    once
        Limits the log lines of refusals.
    session_id
        The id in ``welcome``.
    served
        The scene.
    client_ip
        Address for the log.
    """

    def __init__(
        self,
        metrics: Metrics,
        once: OncePerMinute,
        *,
        session_id: str,
        served: ServedScene,
        client_ip: str,
    ) -> None:
        self._metrics = metrics
        self._once = once
        self._session_id = session_id
        self._payloads = served.payloads
        self._scene_id = served.id
        self._scene_label = metrics.scene_label(served.id)
        self._client_ip = client_ip
        self._is_open = False
        self._opened_s = 0.0
        self._stalled = False
        self._landings = 0
        self._payload_bytes = 0
        self._ended_by: str | None = None

    def opened(self) -> None:
        """Record that the session is open: its hello was accepted."""
        self._is_open = True
        self._opened_s = monotonic()
        self._metrics.sessions.labels(self._scene_label).inc()
        log(
            "session opened", session=self._session_id, scene=self._scene_id, client=self._client_ip
        )

    def ending(self, reason: str) -> None:
        """Record why the service closes the session."""
        self._ended_by = reason

    def closed(self) -> None:
        """Record that the session has ended.

        A connection whose hello was never accepted is not logged, because anybody can open one.
        """
        if not self._is_open:
            return
        reason = self._ended_by or "lost"
        self.credit_stalled(stalled=False)
        self._metrics.sessions.labels(self._scene_label).dec()
        self._metrics.sessions_closed.labels(reason).inc()
        log(
            "session closed",
            session=self._session_id,
            scene=self._scene_id,
            reason=reason,
            seconds=monotonic() - self._opened_s,
            landings=self._landings,
            bytes=self._payload_bytes,
        )

    def planned(
        self, generation: int, *, load: int, keep: int, payload_bytes: int, omitted: int
    ) -> None:
        self._landings += 1
        self._metrics.landings.labels(self._scene_label).inc()
        log(
            "landing planned",
            level=logging.DEBUG,
            landing=self._landing(generation),
            load=load,
            keep=keep,
            bytes=payload_bytes,
            omitted=omitted or None,
        )

    def plan_sent(self, generation: int, seconds: float) -> None:
        self._metrics.plan_s.observe(seconds)
        log("plan sent", level=logging.DEBUG, landing=self._landing(generation), seconds=seconds)

    def first_byte(self, seconds: float) -> None:
        self._metrics.first_byte_s.observe(seconds)

    def ready(
        self, generation: int, *, segments: int, payload_bytes: int, missing: int, seconds: float
    ) -> None:
        self._payload_bytes += payload_bytes
        self._metrics.ready_s.observe(seconds)
        log(
            "landing ready",
            landing=self._landing(generation),
            scene=self._scene_id,
            seconds=seconds,
            segments=segments,
            bytes=payload_bytes,
            missing=missing or None,
        )

    def superseded(self, generation: int, unsent_bytes: int, *, landing: bool) -> None:
        kind = "land" if landing else "prefetch"
        self._metrics.superseded.labels(kind).inc()
        self._metrics.superseded_bytes.labels(kind).inc(unsent_bytes)
        log(
            "superseded",
            level=logging.DEBUG,
            landing=self._landing(generation),
            kind=kind,
            unsent_bytes=unsent_bytes,
        )

    def grouped(self, event: str) -> None:
        self._metrics.group_events.labels(event).inc()

    def credit_stalled(self, *, stalled: bool) -> None:
        if stalled != self._stalled:
            self._stalled = stalled
            self._metrics.stalled.inc(1 if stalled else -1)

    def rejected(self, generation: int, rows: Sequence[int]) -> None:
        if not rows:
            return
        for row in rows:
            self._payloads.reject(row, client_key(self._client_ip))
        self._metrics.rejected_segments.inc(len(rows))
        kind = (self._client_ip, "segment_rejected")
        if self._once.first(kind, asyncio.get_running_loop().time()):
            log(
                "segment_rejected",
                level=logging.WARNING,
                landing=self._landing(generation),
                scene=self._scene_id,
                segment=rows[0],
                reason="the client received it and cannot use it",
            )

    def refused(self, error: Error) -> None:
        note_error(
            self._metrics,
            self._once,
            ErrorCode(error.code),
            error.message,
            client_ip=self._client_ip,
            session_id=self._session_id,
        )

    def _landing(self, generation: int) -> str:
        return f"{self._session_id}-{generation}"


def note_error(
    metrics: Metrics,
    once: OncePerMinute,
    code: ErrorCode,
    text: str,
    *,
    client_ip: str,
    session_id: str | None = None,
) -> None:
    """Count an error told to a client; log the first of its kind per client and minute."""
    metrics.errors.labels(code).inc()
    if once.first((client_ip, code), asyncio.get_running_loop().time()):
        log(
            "refused",
            level=logging.WARNING,
            code=code,
            reason=text,
            client=client_ip,
            session=session_id,
        )
