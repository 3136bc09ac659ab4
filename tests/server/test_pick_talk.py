"""How many picks are under way; the rest is tested by the session."""

from __future__ import annotations

from terraport_server.session.actions import Observer, RunPick, SendMessage
from terraport_server.session.outbox import Outbox
from terraport_server.session.pick_talk import PickTalk
from terraport_wire import Error, Pick, Picked


def test_one_too_many_is_refused_and_the_next_goes_when_one_is_answered() -> None:
    out = Outbox(Observer())
    talk = PickTalk(out, 1)
    for request in (1, 2):
        talk.receive(Pick(request=request, origin=(0.0, 0.0, 0.0), direction=None))
    assert out.pop() == RunPick(1, (0.0, 0.0, 0.0), None)
    refusal = out.pop()
    assert isinstance(refusal, SendMessage)
    assert isinstance(refusal.message, Error)
    assert (refusal.message.request, refusal.message.fatal) == (2, False)
    talk.picked(1, None)
    talk.receive(Pick(request=3, origin=(0.0, 0.0, 0.0), direction=None))
    assert out.pop() == SendMessage(Picked(request=1, hit=None))
    assert out.pop() == RunPick(3, (0.0, 0.0, 0.0), None)
