"""Run the service with uvicorn: in this process, or in several behind one port."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import gc
import json
import logging
import os
import signal
import socket
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import uvicorn
from uvicorn.supervisors import Multiprocess

from terraport_server.app import create_app
from terraport_server.descriptors import raise_limit
from terraport_server.errors import ServerError, SettingsError
from terraport_server.limits import DEFAULT_LIMITS, Limits
from terraport_server.logging import configure_logging, log
from terraport_server.service import Service
from terraport_server.settings import Settings, unknown_variables
from terraport_server.stream import connection

__all__ = ["WORKER_OPTIONS", "connection_class", "host_in_url", "listen", "make_server", "run"]

WORKER_OPTIONS: Final = "TERRAPORT_WORKER_OPTIONS"
"""Environment variable with the options of the command line as JSON, for worker processes."""

_BACKLOG: Final = 2048
"""Connections that wait to be accepted."""

_RECEIVE_BUFFER_BYTES: Final = 64 << 10
"""SO_RCVBUF of accepted sockets: clients send little, so the kernel need not buffer megabytes."""

_KEEP_ALIVE_S: Final = 5
"""Time that an HTTP connection may stay idle after a response."""

_DRAIN_POLL_S: Final = 0.02
"""Interval at which a server that shuts down looks for open sessions."""

_SWITCH_S: Final = 0.0005
"""Interval after which a thread (picks) hands the interpreter to the event loop. Python's default
of 5 ms made a landing during a pick take hundreds of milliseconds."""


def listen(host: str, port: int) -> list[socket.socket]:
    """Open listening sockets on every address of a host.

    Parameters
    ----------
    host
        Name or address.
    port
        0 = any free port.

    Raises
    ------
    ServerError
        When an address is taken, not allowed or unknown.
    """
    opened: list[socket.socket] = []
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, _, _, _, address in dict.fromkeys(found):
            try:
                one = socket.create_server((str(address[0]), port), family=family, backlog=_BACKLOG)
            except OSError as error:
                # A machine without IPv6, for the ::1 of a name like localhost.
                is_absent = error.errno in {errno.EAFNOSUPPORT, errno.EADDRNOTAVAIL}
                if is_absent and len(found) > 1:
                    continue
                raise
            opened.append(one)
            port = one.getsockname()[1]
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
            one.setblocking(False)
    except OSError as error:
        for one in opened:
            one.close()
        raise ServerError(_refusal(host, port, error)) from None
    if not opened:
        what = "expected an address or a name of this machine, e.g. 127.0.0.1"
        raise ServerError(f"could not listen on {host_in_url(host)}:{port}; {what}")
    return opened


def host_in_url(host: str) -> str:
    """Return a host as in URLs: IPv6 in brackets.

    Examples
    --------
    >>> host_in_url("::1"), host_in_url("pit.example")
    ('[::1]', 'pit.example')
    """
    return f"[{host}]" if ":" in host else host


class DrainingServer(uvicorn.Server):
    """uvicorn's server that accepts connections until the open landings are over.

    A client that connects meanwhile receives ``draining`` and when to reconnect; a closed socket
    would look like a wrong address.

    Parameters
    ----------
    config
    service
        Its sessions are drained.
    """

    def __init__(self, config: uvicorn.Config, service: Service) -> None:
        super().__init__(config)
        self._service = service

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Drain the sessions, then stop listening and close what is left."""
        service = self._service
        service.begin_drain()
        loop = asyncio.get_running_loop()
        end_s = loop.time() + service.settings.drain_timeout_s + service.limits.close_timeout_s
        # Polled: uvicorn sets force_exit, at a second signal, without an event.
        while (  # noqa: ASYNC110
            service.session_count and loop.time() < end_s and not self.force_exit
        ):
            await asyncio.sleep(_DRAIN_POLL_S)
        await super().shutdown(sockets)


def make_server(
    settings: Settings, limits: Limits = DEFAULT_LIMITS
) -> tuple[uvicorn.Server, Service]:
    """Return uvicorn's server of one process, and the service behind it.

    Raises
    ------
    SettingsError
        If the settings are not valid or not safe.
    """
    check_certificate(settings)
    app = create_app(settings, limits)
    service: Service = app.state.service
    config = uvicorn.Config(app, ws=connection_class(service), **_options(settings, limits))
    config.load()
    if config.ssl is not None:
        service.access.watch_certificate(config.ssl)
    return DrainingServer(config, service), service


def connection_class(service: Service) -> type[connection.Connection]:
    """Return the class of a service's WebSocket connections, for uvicorn's ``ws`` option."""
    settings, limits = service.settings, service.limits
    return connection.connection_class(
        notsent_lowat_bytes=limits.notsent_lowat_bytes,
        max_messages_per_s=settings.max_messages_per_s,
        close_timeout_s=limits.close_timeout_s,
    )


def _options(settings: Settings, limits: Limits) -> dict[str, Any]:
    """Return the options of uvicorn that are the same in one process and in several."""
    return {
        "host": settings.host,
        "port": settings.port,
        "backlog": _BACKLOG,
        "ssl_certfile": settings.ssl_certfile,
        "ssl_keyfile": settings.ssl_keyfile,
        "timeout_keep_alive": _KEEP_ALIVE_S,
        # Open landings finish, then clients read what is left.
        "timeout_graceful_shutdown": round(settings.drain_timeout_s + limits.close_timeout_s) + 1,
        "forwarded_allow_ips": settings.forwarded_allow_ips,
        # Above max_message_bytes a client receives too_large; above this it is closed (1009).
        "ws_max_size": 4 * limits.session.max_message_bytes,
        # Payloads are compressed offline; deflate would cost 100 times the time.
        "ws_per_message_deflate": False,
        # The session's idle_timeout_s decides, with pongs counted; uvicorn only sends the pings.
        "ws_ping_interval": min(20.0, settings.idle_timeout_s / 3.0),
        "ws_ping_timeout": None,
        "log_config": None,
        "access_log": False,
        "server_header": False,
        "lifespan": "on",
    }


def run(
    settings: Settings,
    options: Mapping[str, Any] | None = None,
    announce: Callable[[int], None] | None = None,
) -> None:
    """Serve until SIGTERM or SIGINT, let open landings finish, and return.

    Parameters
    ----------
    settings
        Checked here.
    options
        Settings that were given on the command line; worker processes read the others from the
        environment.
    announce
        Called once with the port, before logging begins.

    Raises
    ------
    SettingsError
        If the settings are not valid or not safe.
    ServerError
        When the address cannot be listened on, or the service could not start (the log says why).
    """
    settings.check()
    raise_limit()
    sockets = listen(settings.host, settings.port)
    try:
        # Made for several workers too: what each would refuse is refused once, before the address.
        server, service = make_server(settings)
        if announce is not None:
            announce(sockets[0].getsockname()[1])
        configure_logging(settings.log_level, settings.log_format)
        for name in unknown_variables():
            log("unknown setting", level=logging.WARNING, variable=name)
        if settings.workers == 1:
            _run_alone(server, sockets)
        else:
            service.registry.close()
            _run_workers(settings, options or {}, sockets)
    finally:
        for one in sockets:
            one.close()


def prepare_process() -> None:
    """Configure the interpreter of a dedicated server process."""
    sys.setswitchinterval(_SWITCH_S)
    # A search through all modules for garbage would stop the loop for tens of milliseconds.
    gc.collect()
    gc.freeze()
    gc.set_threshold(2000, 10, 10)


def _run_alone(server: uvicorn.Server, sockets: list[socket.socket]) -> None:
    """Serve in this process."""
    prepare_process()
    # uvicorn raises the signal that ended it again: an end that was asked for is a good one.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    if hasattr(signal, "SIGHUP"):
        # "systemctl reload": files of tokens, keys and certificates are watched anyway.
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        server.run(sockets)
    except KeyboardInterrupt:
        return
    except SystemExit as end:
        if end.code == 0:
            return
    if not server.started:
        raise ServerError("the service could not start, expected it to serve; its log says why")


def _run_workers(
    settings: Settings, options: Mapping[str, Any], sockets: list[socket.socket]
) -> None:
    """Serve in several processes: uvicorn starts, watches, replaces and ends them."""
    with contextlib.ExitStack() as stack:
        if "PROMETHEUS_MULTIPROC_DIR" not in os.environ:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="terraport-metrics-"))
            os.environ["PROMETHEUS_MULTIPROC_DIR"] = folder
        os.environ[WORKER_OPTIONS] = json.dumps(dict(options), default=str)
        config = uvicorn.Config(
            "terraport_server.worker:app",
            ws="terraport_server.worker:Connection",
            workers=settings.workers,
            **_options(settings, DEFAULT_LIMITS),
        )
        Multiprocess(config, sockets).run()


def check_certificate(settings: Settings) -> None:
    """Refuse a missing file or one of another kind; OpenSSL's error does not name the file.

    Raises
    ------
    SettingsError
        For ``ssl_certfile`` or ``ssl_keyfile``.
    """
    certificate, key = settings.ssl_certfile, settings.ssl_keyfile
    if certificate is None:
        return
    _check_pem("ssl_certfile", certificate, b"CERTIFICATE-----", "a certificate")
    if key is None:
        return
    text = _check_pem("ssl_keyfile", key, b"PRIVATE KEY-----", "a private key")
    if b"ENCRYPTED" in text:
        what = f"got {key}, which is encrypted, expected a key without a passphrase"
        raise SettingsError("ssl_keyfile", f"{what}: openssl pkey -in {key} -out plain.pem")
    import ssl

    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)
    except ssl.SSLError as error:
        what = f"got {key}, which does not fit {certificate} ({error.reason})"
        raise SettingsError(
            "ssl_keyfile", f"{what}, expected the key of that certificate"
        ) from None


def _check_pem(setting: str, path: Path, mark: bytes, what: str) -> bytes:
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        raise SettingsError(setting, f"there is no file {path}, expected a PEM file") from None
    except OSError as error:
        raise SettingsError(setting, f"cannot read {path}: {error.strerror}") from None
    if b"-----BEGIN" not in text or mark not in text:
        raise SettingsError(setting, f"got {path}, expected {what} in PEM (-----BEGIN ...)")
    return text


def _refusal(host: str, port: int, error: OSError) -> str:
    """Return the error text for an address that cannot be bound, with advice."""
    text = f"could not listen on {host_in_url(host)}:{port}"
    if error.errno == errno.EADDRINUSE:
        advice = "--port 0 for any free one"
        return f"{text}: another program does; stop it, or choose another port: {advice}"
    if error.errno == errno.EACCES:
        return f"{text}: not allowed; expected a port from 1024 on, or the right to use lower ones"
    if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
        what = "expected an address or a name of this machine, e.g. 127.0.0.1, or 0.0.0.0 for all"
        return f"{text}: {error.strerror}; {what}"
    return f"{text}: {error.strerror or error}; expected a free address and port"
