"""A client of the plain `websockets` library, which knows the protocol and nothing else."""

from __future__ import annotations

import ssl
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
import websockets.sync.client
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from terraport_wire import (
    FOLLOWS,
    KEY_DTYPE,
    SUBPROTOCOL,
    Budgets,
    Direction,
    Error,
    Hello,
    Land,
    Message,
    Plan,
    Ready,
    Welcome,
    decode,
    decode_frame,
    encode,
    is_payload,
)

PLENTY = 1 << 30
TIMEOUT_S = 10.0

M = TypeVar("M", bound=Message)


class Piece(NamedTuple):
    """A payload frame, and the segment that the plans before it give its key."""

    generation: int
    key: int
    segment: int
    """-1 of a key that no plan had."""
    offset: int
    total: int
    data: bytes


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
        self.taken_bytes = 0
        """Payload that has arrived."""
        self._segments: dict[int, int] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._context.__exit__(*error)

    def send(self, message: Message) -> None:
        self.socket.send(encode(message))

    def hello(self, **fields: Any) -> Welcome:
        """Say hello, expect to be welcome."""
        self.send_hello(**fields)
        return self.expect(Welcome)

    def send_hello(self, **fields: Any) -> None:
        self.send(make_hello(**fields))

    def land(self, generation: int, position: Any, radius_m: float, **fields: Any) -> None:
        """Send a landing; without ``have`` everything is asked for."""
        fields = {"taken_bytes": self.taken_bytes} | fields
        self.send(make_land(generation, position, radius_m, **fields))

    def receive(self, timeout_s: float = TIMEOUT_S) -> Message | Piece:
        data = self.socket.recv(timeout=timeout_s)
        if is_payload(data):
            assert isinstance(data, bytes)
            frame = decode_frame(data)
            assert frame is not None
            self.taken_bytes += len(frame.data)
            segment = self._segments.get(frame.key, -1)
            return Piece(frame.generation, frame.key, segment, frame.offset, frame.total,
                         bytes(frame.data))  # fmt: skip
        message = decode(data, Direction.SERVER_TO_CLIENT)
        assert isinstance(message, Message)
        if isinstance(message, Plan):
            self._segments.update(zip(*(message.show[name].tolist() for name in ("key", "id")),
                                      strict=True))  # fmt: skip
        return message

    def missing(self, ready: Ready) -> list[int]:
        """Return the segments that a ready calls missing, ascending."""
        keys = [] if ready.missing is None else ready.missing.tolist()
        return sorted(self._segments[key] for key in keys)

    def expect(self, kind: type[M]) -> M:
        """Receive one message of a kind; anything else fails the test."""
        message = self.receive()
        assert isinstance(message, kind), message
        return message

    def until(self, kind: type[M]) -> tuple[M, list[Piece], list[Message]]:
        """Receive up to a message of a kind; return it, the payload and the messages before it."""
        pieces: list[Piece] = []
        messages: list[Message] = []
        while True:
            got = self.receive()
            if isinstance(got, kind):
                return got, pieces, messages
            if isinstance(got, Piece):
                pieces.append(got)
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
        "client": "tests",
        "budgets": Budgets(),
        "credit_bytes": PLENTY,
    }
    return Hello(**(defaults | fields))


def make_land(
    generation: int,
    position: Any,
    radius_m: float,
    *,
    have: Iterable[int] = (),
    taken_bytes: int = 0,
    **fields: Any,
) -> Land:
    """Return a landing of a client that has these keys and no other."""
    keys = np.array([*have], KEY_DTYPE)
    return Land(generation=generation, position=position, radius_m=radius_m, have=keys,
                taken_bytes=taken_bytes, **fields)  # fmt: skip


def follows(plan: Plan) -> list[int]:
    """Return the segments of a plan that were not in ``have``, in order."""
    ids: list[int] = plan.show["id"][(plan.show["flags"] & FOLLOWS) > 0].tolist()
    return ids


def assemble(pieces: Iterable[Piece]) -> dict[int, bytes]:
    """Put payloads together, by segment; pieces must be in order, without gap or overlap."""
    payloads: dict[int, bytearray] = {}
    for piece in pieces:
        payload = payloads.setdefault(piece.segment, bytearray())
        assert piece.offset == len(payload), piece
        payload += piece.data
        assert len(payload) <= piece.total
    return {segment: bytes(payload) for segment, payload in payloads.items()}


def client_context() -> ssl.SSLContext:
    """Return a TLS context that accepts any certificate."""
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context
