"""A client that lands on everything and throws it away, as fast as a socket can be read.

Blocking, for a thread of its own: reading releases the interpreter. It reads frame headers and
skips payload; it answers no pings.
"""

from __future__ import annotations

import socket
import ssl
import time
from contextlib import suppress
from typing import Any, Final

import numpy as np
from websockets.client import ClientProtocol
from websockets.frames import Opcode
from websockets.http11 import Response
from websockets.typing import Subprotocol
from websockets.uri import parse_uri

from terraport_wire import (
    FRAME_HEADER_BYTES,
    KEY_DTYPE,
    SUBPROTOCOL,
    Budgets,
    Credit,
    Direction,
    Hello,
    Land,
    Message,
    Plan,
    Ready,
    Welcome,
    decode,
    encode,
)

__all__ = ["PLENTY", "DrainClient"]

PLENTY: Final = 1 << 40


class DrainClient:
    """One connection.

    Parameters
    ----------
    host, port
        Of the service.
    scene : str
    receive_buffer : int, optional
        SO_RCVBUF.
    address : str, optional
        Of this machine, to come from.
    secure : ssl.SSLContext, optional
        For TLS.
    """

    def __init__(
        self,
        host: str,
        port: int,
        scene: str,
        *,
        receive_buffer: int = 0,
        address: str = "",
        secure: ssl.SSLContext | None = None,
    ) -> None:
        self.socket = socket.socket()
        if address:
            self.socket.bind((address, 0))
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(60)
        self.socket.connect((host, port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if secure is not None:
            self.socket = secure.wrap_socket(self.socket, server_hostname=host)
        uri = parse_uri(f"ws://{host}:{port}/scenes/{scene}/stream")
        self._protocol = ClientProtocol(uri, subprotocols=[Subprotocol(SUBPROTOCOL)], max_size=None)
        self._scratch = bytearray(1 << 18)
        self.generation = 0
        """Of the newest landing."""
        self.taken_bytes = 0
        """Payload that was read."""
        self._protocol.send_request(self._protocol.connect())
        self._flush()
        head = b""
        while not head.endswith(b"\r\n\r\n"):
            head += self._exactly(1)
        self._protocol.receive_data(head)
        (response,) = self._protocol.events_received()
        assert isinstance(response, Response), response
        assert response.status_code == 101, response

    def hello(self, credit_bytes: int = PLENTY, **fields: Any) -> Welcome:
        """Open the session; `fields` are further ones of hello."""
        self.send(Hello(client="trial", budgets=Budgets(), credit_bytes=credit_bytes, **fields))
        self.welcome = welcome = self.message()
        assert isinstance(welcome, Welcome), welcome
        return welcome

    def send(self, *messages: Message) -> None:
        """Send messages in one write."""
        for message in messages:
            data = encode(message)
            assert isinstance(data, bytes)
            self._protocol.send_binary(data)
        self._flush()

    def message(self) -> Message:
        """Receive up to the next message; payload before it is skipped."""
        while True:
            received = self.next()
            if isinstance(received, Message):
                return received

    def wish(self, position: tuple[float, float, float], radius_m: float) -> None:
        """Send a landing of a client that has nothing."""
        self.generation += 1
        self.send(
            Land(
                generation=self.generation,
                position=position,
                radius_m=radius_m,
                have=np.zeros(0, KEY_DTYPE),
                taken_bytes=self.taken_bytes,
            )
        )

    def begin(self, position: tuple[float, float, float], radius_m: float) -> Plan:
        """Land and read the plan."""
        self.wish(position, radius_m)
        while True:
            plan = self.message()
            if isinstance(plan, Plan):
                return plan

    def grant(self, count: int) -> None:
        """Allow the service so many payload bytes more."""
        self.send(Credit(bytes=count))

    def drain(self) -> int:
        """Read up to `ready` and forget it; return the payload bytes."""
        total = 0
        while True:
            received = self.next()
            if isinstance(received, Ready) and received.generation == self.generation:
                return total
            if isinstance(received, int):
                total += received

    def land(self, position: tuple[float, float, float], radius_m: float) -> tuple[int, float]:
        """Land and drain; return payload bytes and seconds."""
        began_s = time.perf_counter()
        plan = self.begin(position, radius_m)
        got, planned = self.drain(), int(plan.show["bytes"].sum())
        assert got == planned, f"{got} bytes, expected {planned}"
        return got, time.perf_counter() - began_s

    def close(self) -> None:
        """Drop the connection without a close frame."""
        with suppress(OSError):
            self.socket.close()

    def next(self) -> Message | int | None:
        """Receive one frame: a message, the number of payload bytes skipped, or a control frame."""
        head = self._exactly(2)
        length = head[1] & 0x7F
        if length >= 126:
            length = int.from_bytes(self._exactly(2 if length == 126 else 8), "big")
        if head[0] & 0x0F != Opcode.BINARY or not length:
            self._exactly(length)
            return None
        first = self._exactly(1)
        if first[0] < 0x80:
            self._skip(length - 1)
            self.taken_bytes += length - FRAME_HEADER_BYTES
            return length - FRAME_HEADER_BYTES
        data = first + self._exactly(length - 1)
        message = decode(data, Direction.SERVER_TO_CLIENT)
        assert isinstance(message, Message)
        return message

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self.socket.recv(count - len(data))
            assert more, "the service closed the connection"
            data += more
        return data

    def _skip(self, count: int) -> None:
        while count > 0:
            got = self.socket.recv_into(self._scratch, min(len(self._scratch), count))
            assert got, "the service closed the connection"
            count -= got

    def _flush(self) -> None:
        for data in self._protocol.data_to_send():
            if data:
                self.socket.sendall(data)
