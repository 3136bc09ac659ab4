"""Keeps access current while the service runs.

Files of tokens and keys are read again when they change; sessions whose token ran out or was taken
away are closed. Both within ``access_check_s`` or two.
"""

from __future__ import annotations

import asyncio
import logging
import ssl
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from terraport_server.auth.gate import Gate, TokenPass, Withdrawal, static_tokens
from terraport_server.auth.keys import read_keys
from terraport_server.errors import SettingsError
from terraport_server.logging import LOGGER, log
from terraport_server.metrics import Metrics
from terraport_server.settings import Settings

__all__ = ["AccessWatch", "Visitor"]

_SAID: Final[dict[Withdrawal, str]] = {
    "expired": "the token has expired, expected a connection with a newer one",
    "revoked": "the token opens this scene no more, expected a connection with another one",
}

_RESTLESS_LOOKS: Final = 10
"""A file that changed at so many looks in a row is read although it may be changing still."""

_Stamps = tuple[tuple[int, int, int] | None, ...]
"""Time, size and inode of each file; None where there is none."""


@dataclass(eq=False, slots=True)
class Visitor:
    """A session whose token is checked again and again: what it opened, and how to end it."""

    scene_id: str
    withdraw: Callable[[str], None]
    """Ends the session with ``unauthorised`` and this text."""
    session_id: str
    token_pass: TokenPass | None = None
    """``None`` until a token was shown."""


@dataclass(slots=True)
class _Watched:
    """A file of tokens, keys or certificates, and the stamps at which it was last read."""

    name: str
    paths: tuple[Path, ...]
    read: Callable[[], Callable[[], None]]
    """Reads it, in a thread; returns what puts it in force, on the event loop."""
    # What was read a moment ago, at the start, may have changed since, so the first look always
    # reads once more.
    used: _Stamps = ()
    seen: _Stamps = ()
    restless: int = 0
    """Looks in a row that each saw another change."""


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
        self._settings = settings
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

        if tokens is not None:
            self._files.append(_Watched("tokens", (tokens,), tokens_again))
        if keys is not None:
            self._files.append(_Watched("token_keys", (keys,), keys_again))

    def watch_certificate(self, context: ssl.SSLContext) -> None:
        """Load the certificate into this context again when it changes, for new connections."""
        certificate, key = self._settings.ssl_certfile, self._settings.ssl_keyfile
        assert certificate is not None
        assert key is not None

        def certificate_again() -> Callable[[], None]:
            try:
                ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)
            except OSError as error:
                what = f"{error}, expected a certificate and its key in PEM"
                raise SettingsError("ssl_certfile", what) from None
            return lambda: context.load_cert_chain(certificate, key)

        self._files.append(_Watched("tls", (certificate, key), certificate_again))

    def add(self, visitor: Visitor) -> None:
        """Watch a session, until :meth:`remove`."""
        self._visitors.add(visitor)

    def remove(self, visitor: Visitor) -> None:
        """Watch a session no more."""
        self._visitors.discard(visitor)

    async def watch(self, period_s: float) -> None:
        """Refresh, and check every visitor, once a period until cancelled."""
        while True:
            await asyncio.sleep(period_s)
            try:
                await self.refresh()
                self.sweep()
            except Exception:  # noqa: BLE001 - a watch that ended would leave every door as it is
                LOGGER.exception("access watch failed")

    async def refresh(self) -> None:
        """Read the files that have changed.

        A file is read when two looks, one period apart, saw the same of it: it may be written in
        place, and half of it would lock people out. What cannot be used is logged once, and what
        was read before stays in force. One that changes again and again is read all the same after
        some looks, if it did not change meanwhile: else nobody could be locked out any more.
        """
        for file in self._files:
            seen = await asyncio.to_thread(_stamps, file.paths)
            quiet = seen == file.seen and seen != file.used
            file.restless = 0 if seen in (file.seen, file.used) else file.restless + 1
            file.seen = seen
            if quiet or file.restless >= _RESTLESS_LOOKS:
                await self._read(file, seen, even_if_changing=quiet)

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

    async def _read(self, file: _Watched, seen: _Stamps, *, even_if_changing: bool) -> None:
        try:
            put_in_force = await asyncio.to_thread(file.read)
            if not even_if_changing and await asyncio.to_thread(_stamps, file.paths) != seen:
                return  # it may be half of one and half of another: the next look tries again
        except SettingsError as error:
            file.used, file.restless = seen, 0
            self._metrics.key_reloads.labels(file.name, "bad").inc()
            log("access file not read", level=logging.ERROR, file=file.name, reason=str(error))
            return
        file.used, file.restless = seen, 0
        put_in_force()
        self._metrics.key_reloads.labels(file.name, "ok").inc()
        log("access file read", file=file.name)


def _stamps(paths: tuple[Path, ...]) -> _Stamps:
    stamps: list[tuple[int, int, int] | None] = []
    for path in paths:
        try:
            status = path.stat()
        except OSError:
            stamps.append(None)
        else:
            stamps.append((status.st_mtime_ns, status.st_size, status.st_ino))
    return tuple(stamps)
