"""The other end of a connection, with no manners: a blocking socket that writes what it is told.

Every wait has a bound. What comes back is parsed just far enough to say whether it is allowed.
"""

from __future__ import annotations

import base64
import contextlib
import random
import socket
import struct
import time
from dataclasses import dataclass, field
from typing import Any, Final, Self

import msgpack

from terraport_wire import SUBPROTOCOL, CloseCode, ErrorCode, is_payload

__all__ = ["ANSWER_S", "Answers", "HangError", "HostilePeer", "frame"]

ANSWER_S: Final = 20.0
"""A connection that is neither answered nor closed within it hangs. The machine may be busy."""

WEBSOCKET_CODES: Final = {1000, 1002, 1003, 1005, 1007, 1009}
"""What RFC 6455 has for a peer that breaks its rules; the protocol's own are `CloseCode`."""

BINARY, TEXT, CONT, CLOSE, PING, PONG = 2, 1, 0, 8, 9, 10


class HangError(AssertionError):
    """The service neither answered nor closed."""


@dataclass
class Answers:
    """What the service answered on one connection, up to its end."""

    status: int | None = None
    """Of the HTTP handshake."""
    errors: list[str] = field(default_factory=list)
    """Codes of error messages."""
    messages: int = 0
    chunks: int = 0
    close_code: int | None = None
    """None where the connection ended without a close frame."""
    wrong: list[str] = field(default_factory=list)
    """What no service may send."""


def frame(
    opcode: int,
    data: bytes,
    *,
    fin: bool = True,
    mask: bool = True,
    rsv: int = 0,
    declared: int | None = None,
    width: int | None = None,
) -> bytes:
    """Write one WebSocket frame, as wrong as one likes.

    Parameters
    ----------
    opcode : int
    data : bytes
    fin, mask, rsv
        Header bits.
    declared : int, optional
        Length to declare instead of the data's.
    width : int, optional
        Bytes of the extended length, 0, 2 or 8, whether or not that is the shortest.
    """
    length = len(data) if declared is None else declared
    if width is None:
        width = 0 if length < 126 else 2 if length < 1 << 16 else 8
    head = bytes([(0x80 if fin else 0) | (rsv << 4) | opcode])
    bit = 0x80 if mask else 0
    if width == 0:
        head += bytes([bit | (length & 0x7F)])
    elif width == 2:
        head += bytes([bit | 126]) + struct.pack("!H", length & 0xFFFF)
    else:
        head += bytes([bit | 127]) + struct.pack("!Q", length & (2**64 - 1))
    # A mask of zeros is legal, and leaves the bytes readable in a report.
    return head + (bytes(4) if mask else b"") + data


class HostilePeer:
    """One TCP connection to the service.

    Parameters
    ----------
    port : int
    address : str, optional
        Of this machine, to come from: Linux has all of 127.0.0.0/8.
    """

    def __init__(self, port: int, *, address: str = "127.0.0.1") -> None:
        self.socket = socket.create_connection(
            ("127.0.0.1", port), ANSWER_S, source_address=(address, 0)
        )
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.inbox = b""
        """What came and was not parsed: of a connection that is no WebSocket, everything."""
        self._is_websocket = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def handshake(self, scene: str, answers: Answers) -> None:
        """Become a WebSocket."""
        key = base64.b64encode(random.Random(1).randbytes(16)).decode()
        self.write(
            f"GET /scenes/{scene}/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n".encode()
        )
        while b"\r\n\r\n" not in self.inbox:
            if not self._fill(time.monotonic() + ANSWER_S):
                raise HangError("closed in the handshake")
        head, _, self.inbox = self.inbox.partition(b"\r\n\r\n")
        answers.status = int(head.split()[1])
        self._is_websocket = True

    def write(self, data: bytes) -> bool:
        """Write everything; False where the service does not want it any more."""
        try:
            self.socket.sendall(data)
        except TimeoutError:
            raise HangError("the service takes no bytes and does not close") from None
        except OSError:
            return False
        return True

    def send(self, *messages: bytes | str) -> bool:
        """Send messages in one write, each in one good frame."""
        data = b""
        for message in messages:
            if isinstance(message, str):
                data += frame(TEXT, message.encode("utf-8", "replace"))
            else:
                data += frame(BINARY, message)
        return self.write(data)

    def until_closed(self, answers: Answers) -> Answers:
        """Read until the service closes; what came is added to the answers.

        Raises
        ------
        HangError
            When it does not, within the bound.
        """
        until_s = time.monotonic() + ANSWER_S
        while self._fill(until_s):
            self._parse(answers)
        return answers

    def finish(self, answers: Answers, *, quiet_s: float) -> Answers:
        """Read until nothing comes for a while, half-close, and read until the service closes."""
        with contextlib.suppress(HangError):
            while self._fill(time.monotonic() + quiet_s):
                self._parse(answers)
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_WR)
        return self.until_closed(answers)

    def _fill(self, until_s: float) -> bool:
        """Receive something; False at the end of the stream."""
        left_s = until_s - time.monotonic()
        if left_s <= 0:
            raise HangError(f"not closed within {ANSWER_S:g} s")
        self.socket.settimeout(left_s)
        try:
            data = self.socket.recv(1 << 16)
        except TimeoutError:
            raise HangError(f"neither answered nor closed within {ANSWER_S:g} s") from None
        except OSError:
            return False
        finally:
            self.socket.settimeout(ANSWER_S)
        self.inbox += data
        return bool(data)

    def _parse(self, answers: Answers) -> None:
        """Take whole frames from the inbox."""
        if not self._is_websocket:
            return
        while len(self.inbox) >= 2:
            first, second = self.inbox[0], self.inbox[1]
            start, length = 2, second & 0x7F
            if length >= 126:
                width = 2 if length == 126 else 8
                start += width
                length = int.from_bytes(self.inbox[2:start], "big")
            if len(self.inbox) < start + length:
                return
            data, self.inbox = self.inbox[start : start + length], self.inbox[start + length :]
            self._judge(first, second, data, answers)

    def _judge(self, first: int, second: int, data: bytes, answers: Answers) -> None:
        opcode = first & 0x0F
        if first & 0x70 or not first & 0x80 or second & 0x80:
            answers.wrong.append(f"a frame of ours begins {first:02x} {second:02x}")
        elif answers.close_code is not None:
            answers.wrong.append("a frame after the close")
        elif opcode == CLOSE:
            answers.close_code = int.from_bytes(data[:2], "big") if len(data) >= 2 else 1005
            if answers.close_code not in WEBSOCKET_CODES | set(CloseCode):
                answers.wrong.append(f"close code {answers.close_code}")
            self.write(frame(CLOSE, data[:2]))
        elif opcode == BINARY and is_payload(data):
            answers.chunks += 1
        elif opcode == BINARY:
            self._judge_message(data, answers)
        elif opcode not in {PING, PONG}:
            answers.wrong.append(f"opcode {opcode}")

    def _judge_message(self, data: bytes, answers: Answers) -> None:
        answers.messages += 1
        message: dict[str, Any] = msgpack.unpackb(data)
        if message["type"] == "error":
            answers.errors.append(message["code"])
            if message["code"] not in set(ErrorCode):
                answers.wrong.append(f"error code {message['code']!r}")
            elif message["code"] == ErrorCode.INTERNAL and message["fatal"]:
                answers.wrong.append(f"the service failed: {message}")
