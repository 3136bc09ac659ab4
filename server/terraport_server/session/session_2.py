"""State machine of one client's session in protocol 2 (spec/protocol-2.md).

PURE: no I/O, no clock. It differs from a session of protocol 1 in its landings alone.
"""

from __future__ import annotations

from terraport_server.session.interface import SendChunk
from terraport_server.session.landings import Landings
from terraport_server.session.plan_2 import table_of
from terraport_server.session.session import Session
from terraport_wire import Message, Unknown, protocol_2
from terraport_wire.messages import Direction

__all__ = ["Session2"]


class Session2(Session):
    """State machine of one connection; not thread-safe. Parameters as for a session."""

    def decode(self, data: bytes | str, max_bytes: int) -> Message | Unknown:
        """Decode a message of the client; raises DecodeError."""
        return protocol_2.decode(data, Direction.CLIENT_TO_SERVER, max_bytes=max_bytes)

    def frame_header(self, chunk: SendChunk, offset: int, length: int) -> bytes:
        """Return the header of a frame with ``length`` bytes of a chunk's segment."""
        del length  # the WebSocket message says it
        return protocol_2.frame_header(
            generation=chunk.generation,
            key=int(table_of(self._scene).hashes[chunk.segment]),
            offset=offset,
            total=chunk.total,
        )

    def _open(self, hello: Message) -> None:
        assert isinstance(hello, protocol_2.Hello)
        if not self._may_open(hello.token):
            return
        scene, limits, table = self._scene, self._limits, table_of(self._scene)
        assert scene.hidden_faces is not None
        self._transfers = Landings(scene, limits, hello, send=self._send, observer=self._observer)
        self._send(
            protocol_2.Welcome(
                server=limits.server,
                session=self.id,
                scene=protocol_2.SceneFacts(
                    id=scene.id,
                    name=scene.name,
                    version=scene.version,
                    segment_count=table.segment_count,
                    base_faces=scene.hidden_faces.base_faces,
                    levels=table.levels,
                ),
                limits=protocol_2.Limits(
                    max_radius_m=limits.max_radius_m,
                    max_message_bytes=limits.max_message_bytes,
                    max_messages_per_s=limits.max_messages_per_s,
                    max_credit_bytes=limits.max_credit_bytes,
                    idle_timeout_s=limits.idle_timeout_s,
                    groups=limits.groups,
                ),
            )
        )

    def _on_landing_message(self, message: Message, now_s: float) -> None:
        landings = self._transfers
        assert isinstance(landings, Landings)
        assert isinstance(message, protocol_2.Land | protocol_2.Prefetch)
        if not (self._take_generation(message.generation) and self._may_go(message)):
            return
        if isinstance(message, protocol_2.Land):
            landings.land(message, now_s)
            self._note_place(message.position, now_s)
        else:
            landings.prefetch(message)
