"""Running the service in the foreground, until a signal."""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import socket
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING

import uvicorn

from terraport_server.app import create_app
from terraport_server.descriptors import make_room
from terraport_server.doorway import Doorway
from terraport_server.errors import ServerError, SettingsError
from terraport_server.group_connection import GroupConnection, passing_class
from terraport_server.http_connection import http_protocol_class
from terraport_server.listeners import Listeners
from terraport_server.logging import configure_logging
from terraport_server.mailbox import Parcel
from terraport_server.service import Service
from terraport_server.settings import Settings
from terraport_server.small_reads import SmallReads
from terraport_server.supervisor import Supervisor
from terraport_server.transport import protocol_class

if TYPE_CHECKING:
    from terraport_server.secure_context import SecureContext

__all__ = ["TerraportServer", "make_server", "run"]

_HTTP_GRACE_S = 2.5
"""A health check every two seconds comes by once."""

_SWITCH_S = 0.0005
"""A thread that works in Python (picks) gives the loop the interpreter after so long. Beside one
the loop waits this time for each call into the kernel, of some ten that a landing takes: with
Python's 5 ms a landing took hundreds. Costs such a thread a twentieth."""


class TerraportServer(uvicorn.Server):
    """uvicorn's server that drains its sessions before it closes their connections."""

    def __init__(
        self, config: uvicorn.Config, service: Service, tls: SecureContext | None = None
    ) -> None:
        super().__init__(config)
        self.service = service
        self.tls = tls
        """Spoken with everybody, if given."""
        self.on_started: Callable[[], Awaitable[None]] | None = None
        """Awaited once clients are accepted."""
        self.on_ended: Callable[[], Awaitable[None]] | None = None
        """Awaited at the very end, when every connection is closed."""
        self.owns_process = False
        """Whether nothing else lives here: then what was loaded is never searched for garbage."""
        self.doorways: list[Doorway] = []
        self._retiring = False
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def http_class(self) -> type[GroupConnection]:
        """Class of this server's HTTP connections, and of no other's."""
        kind = self.config.http_protocol_class
        assert issubclass(kind, GroupConnection)
        return kind

    def accept_from(self, listener: socket.socket) -> Doorway:
        """Accept clients of one more socket, which is closed at the end."""
        kind = self.http_class
        doorway = Doorway(
            listener,
            lambda: self._small_reads(self._new_connection()),
            kind.entrance,
            kind.refused,
            tls=self.tls,
            handshake_timeout_s=kind.limits.header_timeout_s,
            max_coming=kind.limits.max_connections,
        )
        self.doorways.append(doorway)
        return doorway

    def stop_accepting(self, doorway: Doorway) -> None:
        """Accept no more from there; who was accepted stays."""
        doorway.close()
        self.doorways.remove(doorway)

    async def take_over(self, parcel: Parcel) -> None:
        """Serve a connection that another process accepted."""
        connection = self._new_connection()
        connection.parcel = parcel
        parcel.connection.setblocking(False)
        try:
            loop, reads = asyncio.get_running_loop(), self._small_reads(connection)
            await loop.connect_accepted_socket(lambda: reads, parcel.connection)
        except OSError:  # the client is gone
            parcel.connection.close()

    def _small_reads(self, connection: GroupConnection) -> SmallReads:
        return SmallReads(connection, self.http_class.entrance.room)

    def _new_connection(self) -> GroupConnection:
        return self.http_class(
            config=self.config, server_state=self.server_state, app_state=self.lifespan.state
        )

    def retire(self) -> None:
        """End because another process has taken over this one's port: take nobody new from now."""
        self._retiring = True
        self.should_exit = True

    def reread_access(self) -> None:
        """Read the files of tokens, keys and certificates now; from a signal handler."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self.service.access.refresh_soon)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start to accept clients."""
        self._loop = asyncio.get_running_loop()
        await super().startup([])
        for listener in sockets or ():
            self.accept_from(listener)
        if self.tls is not None:
            self.service.access.watch_certificate(self.tls)
        if self.owns_process:
            sys.setswitchinterval(_SWITCH_S)
            # A search through all modules stops the loop for tens of milliseconds.
            gc.collect()
            gc.freeze()
            # Connections leave no rings: the full search is for what fails, and would stop the loop
            # for 20 ms where a thousand are open.
            gc.set_threshold(2000, 10, 10)
        if self.started and self.on_started is not None:
            await self.on_started()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Drain, bounded in time and cut short by a second signal, then shut down."""
        if self._retiring:
            self._leave_port()
        draining = asyncio.create_task(self.service.drain(replaced=self._retiring))
        while not draining.done() and not self.force_exit:
            await asyncio.wait({draining}, timeout=0.1)
        draining.cancel()
        await asyncio.gather(draining, return_exceptions=True)
        if self._retiring:
            await self._let_http_go()
        for doorway in self.doorways:
            doorway.close()
            await doorway.wait_closed()
        await super().shutdown(sockets)
        if self.on_ended is not None:
            await self.on_ended()

    def _leave_port(self) -> None:
        """Accept nobody, and ask HTTP clients to come again on another connection.

        To close theirs would cut off a request that is on its way, which a proxy's pool always may
        have; said with an answer, the next request goes to the successor.
        """
        for doorway in self.doorways:
            doorway.close()
        headers = self.server_state.default_headers
        self.server_state.default_headers = [*headers, (b"connection", b"close")]

    async def _let_http_go(self) -> None:
        """Wait until they have, not for long: who asks nothing now is not answered either."""
        until_s = time.monotonic() + _HTTP_GRACE_S
        kind = self.config.http_protocol_class
        while time.monotonic() < until_s and not self.force_exit:
            if not any(isinstance(one, kind) for one in self.server_state.connections):
                return
            await asyncio.sleep(0.05)


def make_server(settings: Settings) -> TerraportServer:
    """Put application and uvicorn together.

    Raises
    ------
    SettingsError
        When the settings cannot be served with, or not safely.
    """
    tls = _secure_context(settings)
    app = create_app(settings)
    service = app.state.service
    assert isinstance(service, Service)
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        # It bounds connections, too, so uvicorn's limit_concurrency is not needed.
        http=passing_class(http_protocol_class(settings, service.note_refusal)),
        ws=protocol_class(
            service.client_turns,
            notsent_lowat_bytes=settings.notsent_lowat_bytes,
            send_buffer_bytes=settings.send_buffer_bytes,
            congestion_control=settings.congestion_control,
            max_messages_per_s=settings.max_messages_per_s,
            close_timeout_s=settings.close_timeout_s,
        ),
        # A message beyond it is cut off by the WebSocket layer (1009); between max_message_bytes
        # and this, the client is told too_large.
        ws_max_size=4 * settings.max_message_bytes,
        # Payloads are compressed offline; deflate would cost 100 times the time.
        ws_per_message_deflate=False,
        # The session's idle_timeout_s decides, with pongs counted; uvicorn only asks for them.
        ws_ping_interval=min(20.0, settings.idle_timeout_s / 3.0),
        ws_ping_timeout=None,
        timeout_graceful_shutdown=max(1, round(settings.close_timeout_s)),
        forwarded_allow_ips=settings.forwarded_allow_ips,
        # Windows' own loop cannot watch a socket, which TLS takes.
        loop="asyncio:SelectorEventLoop" if tls and sys.platform == "win32" else "auto",
        log_config=None,
        access_log=False,
        server_header=False,
        lifespan="on",
    )
    config.load()
    return TerraportServer(config, service, tls)


def _secure_context(settings: Settings) -> SecureContext | None:
    """Read the certificate, if TLS is spoken: before an address is said, not after."""
    if settings.tls_certificate is None or settings.tls_key is None:
        return None
    try:
        # Here: it is an extra.
        from terraport_server.secure_context import SecureContext
    except ImportError:
        what = 'TLS needs pyOpenSSL, expected "terraport[tls]" to be installed'
        raise SettingsError("tls_certificate", what) from None
    certificate, key = settings.tls_certificate, settings.tls_key
    _check_pem("tls_certificate", certificate, b"CERTIFICATE-----", "a certificate")
    _check_pem("tls_key", key, b"PRIVATE KEY-----", "a private key")
    if b"ENCRYPTED" in key.read_bytes():
        what = f"got {key}, which is encrypted, expected a key without a passphrase"
        raise SettingsError("tls_key", f"{what}: openssl pkey -in {key} -out plain.pem")
    try:
        return SecureContext(certificate, key)
    except OSError as error:
        what = f"got {key}, which does not fit {certificate} ({error.strerror or error})"
        raise SettingsError("tls_key", f"{what}, expected the key of that certificate") from None


def _check_pem(setting: str, path: Path, mark: bytes, what: str) -> None:
    """Refuse a missing file or one of another kind; OpenSSL's error does not name the file."""
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        raise SettingsError(setting, f"there is no file {path}, expected one in PEM") from None
    except OSError as error:
        raise SettingsError(setting, f"cannot read {path}: {error.strerror}") from None
    if b"-----BEGIN" not in text or mark not in text:
        raise SettingsError(setting, f"got {path}, expected {what} in PEM (-----BEGIN ...)")


def run(
    settings: Settings,
    reread: Callable[[], Settings] | None = None,
    announce: Callable[[int], None] | None = None,
) -> None:
    """Serve until SIGTERM or SIGINT, then drain and return.

    Parameters
    ----------
    settings
        Checked here.
    reread
        Reads the settings again, for a rolling restart of several workers.
    announce
        Called once with the port when it is had, before the log begins.

    Raises
    ------
    SettingsError
        When the settings cannot be served with, or not safely.
    ServerError
        When the address cannot be had (which, why, and a port that is free), or the service could
        not start (the log says why).
    """
    settings = settings.model_copy(update={"workers": settings.workers or _core_count()})
    if settings.workers > 1 and os.name == "nt":
        raise SettingsError("workers", f"got {settings.workers} on Windows, expected 1")
    settings.check()
    make_room(settings.max_connections)  # workers inherit it
    listeners = Listeners(settings.host, settings.port, settings.workers)
    try:
        # Made for several workers too: what each of them would refuse is said once, and before the
        # address. They make their own.
        server = make_server(settings)
        is_alone = settings.workers == 1
        if not is_alone:
            server.service.registry.close()
        if announce is not None:
            announce(listeners.port)
        configure_logging(settings.log_level, settings.log_format)
        if is_alone:
            _run_alone(server, listeners)
        else:
            asyncio.run(Supervisor(settings, listeners, reread).run())
    finally:
        listeners.close()


def _run_alone(server: TerraportServer, listeners: Listeners) -> None:
    """Serve in this process."""
    server.owns_process = True
    # uvicorn takes SIGTERM while it serves and raises it again at the end: an end that was asked
    # for is a good one.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, lambda *_: server.reread_access())
    try:
        server.run(sockets=listeners.of(0))
    except KeyboardInterrupt:
        return  # uvicorn raises it again after a graceful end; the end was what was asked for
    except SystemExit as end:
        if end.code == 0:
            return
        # else uvicorn's way to say that it could not start; its log line says why
    if not server.started:
        raise ServerError("the service could not start, expected it to serve; its log says why")


def _core_count() -> int:
    """Cores that this process may use; a container's quota of CPU time is not looked at."""
    affinity = getattr(os, "sched_getaffinity", None)  # Linux alone has it
    return os.cpu_count() or 1 if affinity is None else len(affinity(0))
