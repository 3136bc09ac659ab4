"""A client of the plain `websockets` library, which knows the wire and nothing else."""

from __future__ import annotations

import ssl
from collections.abc import Sequence
from types import TracebackType
from typing import Any, Self, TypeVar

import websockets.sync.client
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from terraport_wire import (
    SUBPROTOCOL,
    Budgets,
    Direction,
    Error,
    Hello,
    Message,
    PayloadFrame,
    Welcome,
    decode,
    decode_frame,
    encode,
    is_payload,
)

PLENTY = 1 << 30
TIMEOUT_S = 10.0

M = TypeVar("M", bound=Message)


class PlainClient:
    """One connection; every wait is bounded."""

    def __init__(
        self,
        url: str,
        *,
        offered: Sequence[str] | None = (SUBPROTOCOL,),
        **options: Any,
    ) -> None:
        self._context = websockets.sync.client.connect(
            url.replace("http", "ws", 1) + "/stream",
            subprotocols=None if offered is None else list(map(Subprotocol, offered)),
            compression=None,
            max_size=None,
            open_timeout=TIMEOUT_S,
            close_timeout=1.0,
            **options,
        )
        self.socket = self._context.__enter__()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._context.__exit__(kind, error, trace)

    def send(self, message: Message) -> None:
        self.socket.send(encode(message))

    def hello(self, **fields: Any) -> Welcome:
        """Say hello, expect to be welcome."""
        self.send_hello(**fields)
        return self.expect(Welcome)

    def send_hello(self, **fields: Any) -> None:
        self.send(make_hello(**fields))

    def receive(self, timeout_s: float = TIMEOUT_S) -> Message | PayloadFrame:
        data = self.socket.recv(timeout=timeout_s)
        if is_payload(data):
            assert not isinstance(data, str)
            frame = decode_frame(data)
            assert isinstance(frame, PayloadFrame)
            return frame
        message = decode(data, Direction.SERVER_TO_CLIENT)
        assert isinstance(message, Message)
        return message

    def expect(self, kind: type[M]) -> M:
        """Receive one message of a kind; anything else fails the test."""
        message = self.receive()
        assert isinstance(message, kind), message
        return message

    def until(self, kind: type[M]) -> tuple[M, list[PayloadFrame], list[Message]]:
        """Receive up to a message of a kind; return it, the frames and the messages before it."""
        frames: list[PayloadFrame] = []
        messages: list[Message] = []
        while True:
            got = self.receive()
            if isinstance(got, kind):
                return got, frames, messages
            if isinstance(got, PayloadFrame):
                frames.append(got)
            else:
                messages.append(got)

    def refused(self) -> tuple[Error, int]:
        """Expect a fatal error and the close after it; return both."""
        error = self.until(Error)[0]
        assert error.fatal
        return error, self.closed()

    def closed(self) -> int:
        """Expect the close; return its code."""
        rcvd = None
        try:
            while True:
                self.socket.recv(timeout=TIMEOUT_S)
        except ConnectionClosed as closed:
            rcvd = closed.rcvd
        assert rcvd is not None, "the connection was lost without a close frame"
        return rcvd.code


def make_hello(**fields: Any) -> Hello:
    defaults: dict[str, Any] = {
        "protocol": (1, 0),
        "client": "tests",
        "encoding": "segment-2",
        "budgets": Budgets(),
        "credit_bytes": PLENTY,
    }
    return Hello(**(defaults | fields))


def assemble(frames: list[PayloadFrame]) -> dict[int, bytes]:
    """Put payloads together; chunks must be in order, without gap or overlap."""
    payloads: dict[int, bytearray] = {}
    for frame in frames:
        payload = payloads.setdefault(frame.segment, bytearray())
        assert frame.offset == len(payload), frame
        payload += frame.chunk
        assert len(payload) <= frame.total
    return {segment: bytes(payload) for segment, payload in payloads.items()}


def client_context() -> ssl.SSLContext:
    """Return a TLS context that accepts any certificate."""
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context
