"""What became of the bytes that were sent for aims.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Iterable

from terraport_server.session.actions import Observer
from terraport_server.session.id_set import IdSet

__all__ = ["AimLedger"]


class AimLedger:
    """Bytes sent for aims, until a landing settles them.

    Every byte is settled once: *used* where the next landing's plan has its segment, *wasted* where
    that plan has not, or where the segment was evicted, rejected, or the session ended before. So
    over a session's life used and wasted bytes add up to what was sent. Each settlement that
    has any bytes is told to the observer.

    Parameters
    ----------
    observer
        Is told by ``aim_ended`` and ``aim_judged``.
    """

    __slots__ = ("_aimed", "_observer", "_sent")

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._sent: dict[int, int] = {}
        self._aimed = False

    @property
    def open_bytes(self) -> int:
        """Bytes that are not settled."""
        return sum(self._sent.values())

    def aim(self) -> None:
        """Note an aim that has a prefetch: the next landing is judged."""
        self._aimed = True

    def sent(self, segment: int, length: int) -> None:
        """Note payload bytes sent for an aim."""
        self._sent[segment] = self._sent.get(segment, 0) + length

    def land(self, plan: IdSet, *, needed_more: bool) -> None:
        """Settle everything by the plan of a landing.

        Parameters
        ----------
        plan
            Ids that it loads or keeps.
        needed_more
            Whether something of it is still to be sent.
        """
        if self._aimed:
            self._aimed = False
            self._observer.aim_judged(hit=not needed_more)
        sent, self._sent = self._sent, {}
        used = sum(length for segment, length in sent.items() if segment in plan)
        self._tell(sum(sent.values()), used)

    def waste(self, segments: Iterable[int]) -> None:
        """Settle segments that are gone before a landing used them."""
        if self._sent:
            self._tell(sum(self._sent.pop(segment, 0) for segment in segments), 0)

    def end(self) -> None:
        """Book the rest as wasted: the session is over."""
        self.waste(list(self._sent))

    def _tell(self, sent_bytes: int, used_bytes: int) -> None:
        if sent_bytes:
            self._observer.aim_ended(sent_bytes, used_bytes)
