"""Reload of changed credential files, and the end of sessions whose token is no longer valid.

Both within ``access_check_s`` x 2.
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

__all__ = ["AccessWatch", "WatchedSession"]

_MESSAGES: Final[dict[Withdrawal, str]] = {
    "expired": "the token has expired, expected a connection with a newer one",
    "revoked": "the token no longer opens this scene, expected a connection with another one",
}

_MAX_CHANGES: Final = 10
"""Consecutive polls with a change after which a file is read although it may still be changing."""

_Stamps = tuple[tuple[int, int, int] | None, ...]
"""Time, size and inode of each file; None where there is none."""


@dataclass(eq=False, slots=True)
class WatchedSession:
    """A session whose token is checked periodically."""

    scene_id: str
    withdraw: Callable[[str], None]
    """Ends the session with ``unauthorised`` and this text."""
    session_id: str
    token_pass: TokenPass | None = None
    """``None`` until the client has sent a token."""


@dataclass(slots=True)
class _WatchedFile:
    """Tokens, keys, or a certificate with its key."""

    name: str
    paths: tuple[Path, ...]
    read: Callable[[], Callable[[], None]]
    """Reads the file, in a thread; returns what applies it, on the event loop."""
    # Empty at first: the file may have changed since it was read at the start.
    used: _Stamps = ()
    """Stamps of the contents that were last read."""
    seen: _Stamps = ()
    """Stamps at the last poll."""
    changes: int = 0
    """Consecutive polls that saw a change."""


class AccessWatch:
    """Watches credential files and sessions. Used on one event loop.

    Parameters
    ----------
    gate
        Updated when a file changes.
    settings
        The files.
    metrics
    """

    def __init__(self, gate: Gate, settings: Settings, metrics: Metrics) -> None:
        self._gate = gate
        self._settings = settings
        self._metrics = metrics
        self._sessions: set[WatchedSession] = set()
        self._files: list[_WatchedFile] = []
        tokens, keys = settings.tokens_file, settings.token_keys_file

        def reload_tokens() -> Callable[[], None]:
            read = static_tokens(settings)
            return lambda: gate.use_tokens(read)

        def reload_keys() -> Callable[[], None]:
            assert keys is not None
            read = read_keys(keys)
            return lambda: gate.use_keys(read)

        if tokens is not None:
            self._files.append(_WatchedFile("tokens", (tokens,), reload_tokens))
        if keys is not None:
            self._files.append(_WatchedFile("token_keys", (keys,), reload_keys))

    def watch_certificate(self, context: ssl.SSLContext) -> None:
        """Load the certificate into this context again when it changes, for new connections."""
        certificate, key = self._settings.ssl_certfile, self._settings.ssl_keyfile
        assert certificate is not None
        assert key is not None

        def reload_certificate() -> Callable[[], None]:
            try:
                ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)
            except OSError as error:
                what = f"{error}, expected a certificate and its key in PEM"
                raise SettingsError("ssl_certfile", what) from None
            return lambda: context.load_cert_chain(certificate, key)

        self._files.append(_WatchedFile("tls", (certificate, key), reload_certificate))

    def add(self, session: WatchedSession) -> None:
        """Watch a session, until :meth:`remove`."""
        self._sessions.add(session)

    def remove(self, session: WatchedSession) -> None:
        """Stop watching a session."""
        self._sessions.discard(session)

    async def watch(self, period_s: float) -> None:
        """Reload files and check every session, once a period until cancelled."""
        while True:
            await asyncio.sleep(period_s)
            try:
                await self.refresh()
                self.end_withdrawn()
            except Exception:  # noqa: BLE001 - without the watch, no token could be revoked
                LOGGER.exception("access watch failed")

    async def refresh(self) -> None:
        """Reload the files that have changed.

        A file is read when two consecutive polls saw the same stamps, since half of a file that is
        written in place would lock clients out. An invalid file is logged once, and the last valid
        contents stay in force. A file that keeps changing is read after `_MAX_CHANGES` polls, if it
        did not change during the read: otherwise no token could be revoked.
        """
        for file in self._files:
            stamps = await asyncio.to_thread(_stamps, file.paths)
            is_stable = stamps == file.seen and stamps != file.used
            file.changes = 0 if stamps in (file.seen, file.used) else file.changes + 1
            file.seen = stamps
            if is_stable or file.changes >= _MAX_CHANGES:
                await self._reload(file, stamps, is_stable=is_stable)

    def end_withdrawn(self) -> None:
        """End the sessions whose token no longer opens their scene."""
        for session in list(self._sessions):
            token_pass = session.token_pass
            if token_pass is None:
                continue
            reason = self._gate.withdrawal(token_pass, session.scene_id)
            if reason is None:
                continue
            self._sessions.discard(session)
            self._metrics.withdrawn.labels(reason).inc()
            log(
                "access withdrawn",
                session=session.session_id,
                scene=session.scene_id,
                token_name=token_pass.name,
                reason=reason,
            )
            session.withdraw(_MESSAGES[reason])

    async def _reload(self, file: _WatchedFile, stamps: _Stamps, *, is_stable: bool) -> None:
        try:
            apply = await asyncio.to_thread(file.read)
        except SettingsError as error:
            apply, outcome = None, "bad"
            log("access file not read", level=logging.ERROR, file=file.name, reason=str(error))
        else:
            if not is_stable and await asyncio.to_thread(_stamps, file.paths) != stamps:
                return  # it changed during the read: the next poll tries again
            outcome = "ok"
            log("access file read", file=file.name)
        file.used, file.changes = stamps, 0
        self._metrics.key_reloads.labels(file.name, outcome).inc()
        if apply is not None:
            apply()


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
