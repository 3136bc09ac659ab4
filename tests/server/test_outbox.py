"""What a session has to say: answers in order, news as the newest alone."""

from __future__ import annotations

from terraport_server.session.actions import Close, Observer, SendMessage
from terraport_server.session.outbox import Outbox
from terraport_wire import CloseCode, ErrorCode, Gathering, Notice, Roster


def roster(group: str) -> Roster:
    return Roster(group=group, members=())


def gathering(number: int) -> Gathering:
    return Gathering(gathering=number, guide=1, position=(0.0, 0.0, 0.0), radius_m=9.0)


def test_of_news_that_waits_the_newest_of_each_type_is_kept() -> None:
    out = Outbox(Observer())
    for number in range(1, 5000):
        out.post(gathering(number))
        out.post(roster(f"g{number}"))
    out.say(Notice(kind="draining"))
    assert len(out) == 1, "news is not counted"
    messages = [out.pop(), out.pop(), out.pop(), out.pop()]
    assert messages == [
        SendMessage(Notice(kind="draining")),
        SendMessage(gathering(4999)),
        SendMessage(roster("g4999")),
        None,
    ]


def test_nothing_follows_a_close() -> None:
    out = Outbox(Observer())
    out.post(roster("a"))
    out.fatal(ErrorCode.TIMEOUT, "x" * 2000)
    out.fatal(ErrorCode.INTERNAL, "again")
    message = out.pop()
    assert isinstance(message, SendMessage)
    assert out.pop() == Close(CloseCode.TIMEOUT, ErrorCode.TIMEOUT)
    assert out.pop() is None
    assert out.closing
