"""One session's part in the talk about groups: who may ask, and how it is answered.

PURE: no I/O, no clock. spec/wire-protocol.md, section 16.
"""

from __future__ import annotations

from terraport_server.groups.state import Place
from terraport_server.session.actions import GroupPort, Observer
from terraport_server.session.outbox import Outbox
from terraport_wire import Arrived, ErrorCode, Gather, Join, Joined, Leave, Message

__all__ = ["GroupMessage", "GroupTalk"]

GroupMessage = Join | Leave | Gather | Arrived


class GroupTalk:
    """Between a session and the groups of its process.

    Parameters
    ----------
    port
        Way to the groups; ``None`` where there are none.
    out
        The session's outbox.
    max_radius_m
        Largest radius of a group landing.
    observer
        Told of what happens.
    """

    def __init__(
        self, port: GroupPort | None, out: Outbox, *, max_radius_m: float, observer: Observer
    ) -> None:
        self._port = port
        self._out = out
        self._max_radius_m = max_radius_m
        self._observer = observer
        self._place: Place | None = None
        """Centre of the newest landing that was taken: who joins later stands there (16.1)."""

    def receive(self, message: GroupMessage, now_s: float, *, draining: bool) -> None:
        """Take one message of the client."""
        if isinstance(message, Join | Gather):
            refusal = self._ask(message, now_s, draining=draining)
            self._observer.grouped(message.TYPE if refusal is None else "refused")
            if refusal is not None:
                self._out.error(ErrorCode.GROUP_REFUSED, refusal, request=message.request)
        elif isinstance(message, Leave):
            self.leave(now_s)
        elif self._port is not None:
            self._port.arrived(message)

    def landed(self, place: Place, now_s: float) -> None:
        """Note where the client lands, in metres of the scene frame."""
        self._place = place
        if self._port is not None:
            self._port.landed(place, now_s)

    def leave(self, now_s: float) -> None:
        """Give up the seat, if there is one, and tell nothing more of the group."""
        self._out.unpost()
        if self._port is not None:
            self._port.leave(now_s)

    def tell(self, message: Message) -> None:
        """Pass on a message of the group; of news that waits, only the newest is kept (16.4)."""
        if isinstance(message, Joined):
            self._out.unpost()  # news of a seat held before
            self._out.say(message)
        elif not self._out.closing:
            self._out.post(message)

    def _ask(self, message: Join | Gather, now_s: float, *, draining: bool) -> str | None:
        """Return why a join or gather is refused."""
        most_m = self._max_radius_m
        if self._port is None:
            return f"got {message.TYPE}, expected none: no groups are served here"
        if draining:
            return f"got {message.TYPE} while the server goes away, expected a new connection"
        if isinstance(message, Join):
            return self._port.join(message, self._place, now_s)
        if message.radius_m > most_m:
            return f"gather.radius_m: got {message.radius_m:g}, expected at most {most_m:g}"
        return self._port.gather(message, now_s)
