"""The service's certificate, and the handshake of whoever comes with TLS."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable
from pathlib import Path

from cryptography.hazmat.bindings.openssl.binding import Binding
from OpenSSL import SSL

from terraport_server.secure_rooms import Rooms, said_by_openssl
from terraport_server.secure_transport import READ_BYTES, SecureTransport

__all__ = ["SecureContext"]


class SecureContext:
    """Certificate and key of this service; read again while it runs.

    Parameters
    ----------
    certificate, key
        Of PEM.

    Raises
    ------
    OSError
        As of :meth:`load`.
    """

    def __init__(self, certificate: Path, key: Path) -> None:
        self._paths = certificate, key
        self._rooms = Rooms()
        self._current = self.load()

    def load(self) -> SSL.Context:
        """Read both again; :meth:`use` puts what was read in force.

        Raises
        ------
        OSError
            When one cannot be read, is no PEM, or they do not belong together.
        """
        certificate, key = self._paths
        context = SSL.Context(SSL.TLS_SERVER_METHOD)
        context.set_min_proto_version(SSL.TLS1_2_VERSION)
        context.set_options(SSL.OP_NO_RENEGOTIATION | SSL.OP_CIPHER_SERVER_PREFERENCE)
        # A send encrypts all it is given; and who waits for something to read has no buffer.
        context.clear_mode(Binding.lib.SSL_MODE_ENABLE_PARTIAL_WRITE)
        context.set_mode(SSL.MODE_RELEASE_BUFFERS)
        context.set_session_cache_mode(SSL.SESS_CACHE_OFF)  # clients keep theirs, as tickets
        for path in (certificate, key):
            path.read_bytes()  # OpenSSL does not say which is missing
        try:
            context.use_certificate_chain_file(str(certificate))
            context.use_privatekey_file(str(key))
            context.check_privatekey()
        except SSL.Error as error:
            raise OSError(said_by_openssl(error)) from None
        return context

    def use(self, context: SSL.Context) -> None:
        """Show this certificate to whoever comes from now on."""
        self._current = context

    async def accept(
        self,
        connection: socket.socket,
        make_protocol: Callable[[], asyncio.BaseProtocol],
        timeout_s: float,
    ) -> SecureTransport:
        """Shake hands, then connect a protocol.

        Parameters
        ----------
        connection
            Accepted, not blocking; the transport's from then on.
        make_protocol
            Called after the handshake.
        timeout_s
            Of the handshake.

        Raises
        ------
        OSError
            When it fails, or takes longer (`TimeoutError`).
        """
        loop = asyncio.get_running_loop()
        tls = SSL.Connection(self._current, None)
        tls.set_accept_state()
        if connection.family in {socket.AF_INET, socket.AF_INET6}:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        async with asyncio.timeout(timeout_s):
            is_done = False
            while not is_done:
                heard = await loop.sock_recv(connection, READ_BYTES)
                if not heard:
                    raise ConnectionResetError
                tls.bio_write(heard)
                is_done = _shakes_hands(tls, connection)
                said = _said_by(tls)
                if said:
                    await loop.sock_sendall(connection, said)
        transport = SecureTransport(loop, connection, tls, make_protocol(), self._rooms)
        transport.begin()
        return transport


def _shakes_hands(tls: SSL.Connection, connection: socket.socket) -> bool:
    """Go on with a handshake; tell whether it is done."""
    try:
        tls.do_handshake()
    except SSL.WantReadError:
        return False
    except SSL.Error as error:
        with contextlib.suppress(SSL.Error, OSError):
            connection.send(tls.bio_read(READ_BYTES))  # the alert
        raise ConnectionAbortedError(said_by_openssl(error)) from None
    return True


def _said_by(tls: SSL.Connection) -> bytes:
    """Return what a handshake wants to be sent."""
    said = b""
    with contextlib.suppress(SSL.WantReadError):
        while True:
            said += tls.bio_read(READ_BYTES)
    return said
