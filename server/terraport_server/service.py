"""State of a server process that its clients share."""

from __future__ import annotations

import asyncio
import logging
import time
from importlib.metadata import PackageNotFoundError, version
from typing import Final

from terraport_server.auth.gate import Gate
from terraport_server.auth.watch import AccessWatch
from terraport_server.errors import PickTimeoutError
from terraport_server.fair_queue import PickQueue, PlanQueue
from terraport_server.groups.hub import GroupHub
from terraport_server.limits import DEFAULT_LIMITS, Limits
from terraport_server.logging import OncePerMinute, log
from terraport_server.metrics import Metrics
from terraport_server.scenes.picking import MeshCache, pick
from terraport_server.scenes.registry import SceneRegistry
from terraport_server.scenes.roots import root_of
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.scenes.strokes import StrokeCache
from terraport_server.scenes.tileset import TilesetCache
from terraport_server.session.interface import RunPick
from terraport_server.session.rate_limit import RateLimit, RatesByName
from terraport_server.settings import Settings
from terraport_server.stream.limits import SessionCounts
from terraport_server.stream.scheduler import SendScheduler
from terraport_server.stream.sender import Sender, SenderLimits
from terraport_store import OriginError
from terraport_wire import Hit

__all__ = ["METRIC_PAGES_PER_S", "Service", "server_name"]

METRIC_PAGES_PER_S: Final = 10.0
"""Maximum pages of /metrics made per second, averaged over 10 s; above it the last one is sent."""


def server_name() -> str:
    """Return name and version of the service."""
    try:
        return f"terraport {version('terraport')}"
    except PackageNotFoundError:  # a checkout on PYTHONPATH
        return "terraport"


class Service:
    """Scenes, access, metrics and sessions of one process, on one event loop.

    Parameters
    ----------
    settings
        Settings that passed :meth:`Settings.check`.
    limits
        The fixed limits.

    Raises
    ------
    SettingsError
        If tokens cannot be read.
    """

    def __init__(self, settings: Settings, limits: Limits = DEFAULT_LIMITS) -> None:
        self.settings = settings
        self.limits = limits
        self.gate = Gate.from_settings(settings, limits.token_leeway_s)
        self.metrics = Metrics()
        self.access = AccessWatch(self.gate, settings, self.metrics)
        # Scenes.
        root = root_of(settings, limits)
        root.show_counts(self.metrics.registry)
        self.registry = SceneRegistry(
            root,
            published=self._published,
            pull_base_url=settings.pull_base_url,
        )
        self.tiles = TilesetCache()
        self.strokes = StrokeCache()
        self.painters = RatesByName(limits.max_strokes_per_s)
        # Limits of every session.
        self.session_limits = limits.of_session(settings, server_name())
        self.sender_limits = SenderLimits(
            max_message_bytes=limits.session.max_message_bytes,
            max_pending_actions=limits.max_pending_actions,
            close_timeout_s=limits.close_timeout_s,
        )
        # Shared by sessions: groups, and the queues of plans, picks and payload.
        routing = settings.groups_served
        self.groups = None if routing == "none" else GroupHub(limits.groups, routing)
        if self.groups is not None:
            groups = self.groups.groups
            self.metrics.groups.set_function(lambda: groups.group_count)
            self.metrics.group_members.set_function(lambda: groups.member_count)
        self.scheduler = SendScheduler()
        self.plans = PlanQueue()
        self._cache = MeshCache(limits.pick_cache_bytes)
        self._picks = PickQueue[Hit | None](limits.pick_threads)
        self.once = OncePerMinute()
        # State of the service and its sessions.
        self.ready = False
        """Whether the scenes were read and clients are accepted."""
        self.draining = False
        self._metric_pages = RateLimit(METRIC_PAGES_PER_S, now_s=time.monotonic())
        self._metric_page = b""
        self._senders: dict[Sender, ServedScene] = {}
        self.session_counts = SessionCounts(settings.max_sessions, settings.max_sessions_per_ip)
        self._tasks: list[asyncio.Task[None]] = []

    def render_metrics(self) -> bytes:
        """Return the page of /metrics for all processes; see `METRIC_PAGES_PER_S`."""
        if self._metric_pages.take(time.monotonic()) or not self._metric_page:
            self._metric_page = self.metrics.render()
        return self._metric_page

    @property
    def session_count(self) -> int:
        """Number of open sessions."""
        return len(self.session_counts)

    async def start(self) -> None:
        """Open the scenes and start to watch them."""
        try:
            await self.registry.refresh()
        except OriginError as error:  # retried; until then /readyz reports that there is no scene
            what = "no scene is served until the storage answers; it is retried"
            log("scenes not listed", level=logging.ERROR, reason=str(error), effect=what)
        is_folder = self.settings.scenes_url is None
        poll_s = self.limits.scene_poll_s if is_folder else self.limits.object_poll_s
        self._tasks = [
            asyncio.create_task(self.registry.watch(poll_s)),
            asyncio.create_task(self.access.watch(self.limits.access_check_s)),
            asyncio.create_task(self.metrics.watch_loop()),
        ]
        self.ready = True

    def begin_drain(self) -> None:
        """Refuse new sessions; open landings finish within drain_timeout_s, then sessions end."""
        if self.draining:
            return
        self.draining = True
        settings = self.settings
        if self._senders:
            log("draining", sessions=len(self._senders))
        for sender in self._senders:
            sender.session.drain(
                time.monotonic(),
                settings.drain_timeout_s,
                reconnect_after_ms=self.limits.session.reconnect_after_ms,
            )
            sender.wake()

    async def stop(self) -> None:
        """Stop all tasks and close the scenes."""
        self.ready = False
        if self.groups is not None:
            self.groups.stop()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self.strokes.stop()
        # Pick threads read from the scenes, so they end first, within the time limit of a pick.
        await asyncio.to_thread(self._picks.shutdown, wait=True)
        self.registry.close()

    def note_refusal(self, reason: str, text: str, client_ip: str) -> None:
        """Count a refused client; log the first refusal per client, reason and minute."""
        self.metrics.refused.labels(reason).inc()
        if self.once.first((client_ip, reason), time.monotonic()):
            log("refused", level=logging.WARNING, code=reason, reason=text, client=client_ip)

    def add(self, sender: Sender, served: ServedScene) -> None:
        """Register a session; its scene stays open, and it receives notices."""
        served.hold()
        self._senders[sender] = served

    def remove(self, sender: Sender) -> None:
        """Remove a session and release its scene."""
        served = self._senders.pop(sender)
        served.release()

    async def run_pick(self, served: ServedScene, action: RunPick, client: str) -> Hit | None:
        """Run a pick in a thread, when the fair queue allows, within the time limit.

        When cancelled, the thread continues to its end; the scene stays open until then.

        Raises
        ------
        PickTimeoutError
            If it takes too long.
        """
        settings, limits = self.settings, self.limits
        due_s = time.monotonic() + limits.pick_timeout_s

        def work() -> Hit | None:
            if time.monotonic() > due_s:
                raise PickTimeoutError(0)
            return pick(
                served.scene,
                self._cache,
                action.origin,
                action.direction,
                names=served.names,
                max_distance_m=settings.max_radius_m,
                max_segments=limits.pick_max_segments,
                time_is_up=lambda: time.monotonic() > due_s,
                failed=failed,
            )

        def failed(segment: int, error: Exception) -> None:
            served.tell_failure("segment_corrupt", segment, error)
            self.metrics.corrupt_segments.labels(self.metrics.scene_label(served.id)).inc()

        served.hold()
        return await (served.pickers or self._picks).run(client, work, served.release)

    def _published(self, served: ServedScene) -> None:
        for sender, using in self._senders.items():
            if using.id == served.id:
                sender.session.scene_published(served.version)
                sender.wake()
