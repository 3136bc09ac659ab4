"""Keeps access current while the service runs.

Files of tokens and keys are read again when they change; sessions whose token ran out or was taken
away are closed. Both within ``access_check_s`` or two.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from terraport_server.auth import Gate, TokenPass, Withdrawal, static_tokens
from terraport_server.errors import SettingsError
from terraport_server.logs import LOGGER, log
from terraport_server.metrics import Metrics
from terraport_server.settings import Settings
from terraport_server.token_keys import read_keys

__all__ = ["AccessWatch", "Visitor"]

_SAID: Final[dict[Withdrawal, str]] = {
    "expired": "the token has expired, expected a connection with a newer one",
    "revoked": "the token opens this scene no more, expected a connection with another one",
}

_Stamp = tuple[int, int, int] | None


@dataclass(eq=False, slots=True)
class Visitor:
    """One session, as far as access goes."""

    scene_id: str
    withdraw: Callable[[str], None]
    """Ends the session with ``unauthorised`` and this text."""
    session_id: str
    token_pass: TokenPass | None = None
    """``None`` until a token was shown."""


@dataclass(slots=True)
class _Watched:
    """One file, and what was last seen of it."""

    name: str
    path: Path
    read: Callable[[], Callable[[], None]]
    """Reads it, in a thread; returns what puts it in force, on the event loop."""
    used: _Stamp
    seen: _Stamp = field(init=False)

    def __post_init__(self) -> None:
        self.seen = self.used


class AccessWatch:
    """Watches files and sessions. Lives on one event loop.

    Parameters
    ----------
    gate
        What it keeps current.
    settings
        Which files.
    metrics
        Counters.
    """

    def __init__(self, gate: Gate, settings: Settings, metrics: Metrics) -> None:
        self._gate = gate
        self._metrics = metrics
        self._visitors: set[Visitor] = set()
        self._files: list[_Watched] = []
        tokens, keys = settings.tokens_file, settings.token_keys_file

        def tokens_again() -> Callable[[], None]:
            read = static_tokens(settings)
            return lambda: gate.use_tokens(read)

        def keys_again() -> Callable[[], None]:
            assert keys is not None
            read = read_keys(keys)
            return lambda: gate.use_keys(read)

        # What was read a moment ago, at the start, may have changed since: then the stamp is the
        # newer one, and the file would be read no more. So the first look always reads.
        if tokens is not None:
            self._files.append(_Watched("tokens", tokens, tokens_again, None))
        if keys is not None:
            self._files.append(_Watched("token_keys", keys, keys_again, None))

    def add(self, visitor: Visitor) -> None:
        """Watch a session, until :meth:`remove`."""
        self._visitors.add(visitor)

    def remove(self, visitor: Visitor) -> None:
        """Watch a session no more."""
        self._visitors.discard(visitor)

    async def watch(self, period_s: float) -> None:
        """Look again and again until cancelled."""
        while True:
            await asyncio.sleep(period_s)
            try:
                await self.refresh()
                self.sweep()
            except Exception:  # noqa: BLE001 - a watch that ended would leave every door as it is
                LOGGER.exception("access watch failed")

    async def refresh(self, *, at_once: bool = False) -> None:
        """Read the files that have changed.

        A file is read when two looks, one period apart, saw the same of it: it may be written in
        place, and half of it would lock people out. What cannot be used is logged once, and what
        was read before stays in force.

        Parameters
        ----------
        at_once
            Read every file now, changed or not: an operator asked for it.
        """
        for file in self._files:
            seen = await asyncio.to_thread(_stamp, file.path)
            quiet = seen == file.seen and seen != file.used
            file.seen = seen
            if quiet or at_once:
                file.used = seen
                await self._read(file)

    def sweep(self) -> None:
        """End the sessions whose token opens their scene no more."""
        for visitor in list(self._visitors):
            if visitor.token_pass is None:
                continue
            why = self._gate.withdrawal(visitor.token_pass, visitor.scene_id)
            if why is None:
                continue
            self._visitors.discard(visitor)
            self._metrics.withdrawn.labels(why).inc()
            log(
                "access withdrawn",
                session=visitor.session_id,
                scene=visitor.scene_id,
                token_name=visitor.token_pass.name,
                reason=why,
            )
            visitor.withdraw(_SAID[why])

    async def _read(self, file: _Watched) -> None:
        try:
            put_in_force = await asyncio.to_thread(file.read)
        except SettingsError as error:
            self._metrics.key_reloads.labels(file.name, "bad").inc()
            log("access file not read", level=logging.ERROR, file=file.name, reason=str(error))
            return
        put_in_force()
        self._metrics.key_reloads.labels(file.name, "ok").inc()
        log("access file read", file=file.name)


def _stamp(path: Path) -> _Stamp:
    """Time, size and inode of a file; None where there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return (status.st_mtime_ns, status.st_size, status.st_ino)
