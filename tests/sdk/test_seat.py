"""The client's half of groups against the server's, without a socket: cuts and refusals."""

from __future__ import annotations

from typing import Any

import pytest

from terraport.cache import SegmentCache
from terraport.core import SessionCore
from terraport.errors import UsageError
from terraport.events import GroupEvent, GroupRefused
from terraport.options import SessionOptions
from terraport_server.groups.groups import Groups
from terraport_server.groups.state import GroupLimits
from terraport_wire import (
    Arrived,
    Direction,
    Error,
    Gather,
    Gathered,
    Gathering,
    Join,
    Joined,
    Leave,
    Limits,
    Message,
    Roster,
    SceneFacts,
    Welcome,
    decode,
    encode,
)


class Client:
    """One client state machine on one hall of groups; `cut` swallows what is on its way."""

    def __init__(self, groups: Groups, key: str, welcome: Welcome) -> None:
        self.groups = groups
        self.key, self.connections = key, 0
        self.welcome = welcome
        self.state = SessionCore(SessionOptions(client="t"), SegmentCache(0))
        self.events: list[Any] = []
        self.sent: list[Message] = []
        self.connect()

    def connect(self) -> None:
        self.connections += 1
        self.state.connected()
        self.state.data_to_send()
        self.state.receive(encode(self.welcome))

    def cut(self) -> None:
        self.groups.lost((self.key, self.connections), 0.0)
        self.state.connection_lost()

    def hear(self, message: Message) -> None:
        self.state.receive(encode(message))
        self.events += [event for event in self.state.events() if isinstance(event, GroupEvent)]

    def speak(self) -> None:
        key = (self.key, self.connections)
        for data in self.state.data_to_send():
            message = decode(data, Direction.CLIENT_TO_SERVER)
            assert isinstance(message, Message)
            self.sent.append(message)
            refusal = None
            if isinstance(message, Join):
                refusal = self.groups.join(
                    key, "pit", message, 0.0, new_secret=f"{key}", may_guide=True
                )
            elif isinstance(message, Gather):
                refusal = self.groups.gather(key, message, 0.0)
            elif isinstance(message, Leave):
                self.groups.leave(key, 0.0)
            elif isinstance(message, Arrived):
                self.groups.arrived(key, message.gathering, message.state)
            if refusal is not None:
                request = message.request  # type: ignore[attr-defined]
                self.hear(
                    Error(code="group_refused", message=refusal, fatal=False, request=request)
                )

    def heard(self, kind: type) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]


def settle(*clients: Client) -> None:
    """Let everything be said and heard; time passes for rosters."""
    for _ in range(6):
        for client in clients:
            client.speak()
        clients[0].groups.tick(10.0)
        for key, message in clients[0].groups.take_messages():
            for client in clients:
                if key == (client.key, client.connections):
                    client.hear(message)


@pytest.fixture
def welcome() -> Welcome:
    scene = SceneFacts(id="x", version="v", name="x", segment_count=1, base_faces=8, levels=1)
    limits = Limits(
        max_radius_m=500,
        max_message_bytes=1 << 20,
        max_messages_per_s=60,
        max_credit_bytes=1 << 20,
        idle_timeout_s=60,
        groups="here",
    )
    return Welcome(server="s", session="s", scene=scene, limits=limits)


@pytest.fixture
def two(welcome: Welcome) -> tuple[Client, Client]:
    groups = Groups(GroupLimits(group_absence_s=100.0))
    guide, member = Client(groups, "g", welcome), Client(groups, "m", welcome)
    guide.state.seat.join("tour", "guide", "Ann")
    member.state.seat.join("tour", "member")
    settle(guide, member)
    return guide, member


def test_joined_rostered_called_and_gathered(two: tuple[Client, Client]) -> None:
    guide, member = two
    assert [(e.member, e.role) for e in guide.heard(Joined)] == [(1, "guide")]
    assert [(m.name, m.role) for m in member.heard(Roster)[-1].members] == [
        ("Ann", "guide"),
        (None, "member"),
    ]
    guide.state.seat.gather((1, 2, 3), 9.0, deadline_ms=50_000)
    settle(guide, member)
    (called,) = member.heard(Gathering)
    assert (called.position, called.left_ms) == ((1.0, 2.0, 3.0), 50_000)
    for client in two:
        client.state.seat.arrived(1, "ready")
    settle(guide, member)
    (gathered,) = member.heard(Gathered)
    assert (gathered.gathering, gathered.ready.tolist()) == (1, [1, 2])


def test_what_a_cut_swallowed_is_said_again_and_told_once(two: tuple[Client, Client]) -> None:
    guide, member = two
    guide.state.seat.gather((1, 2, 3), 9.0)
    settle(guide, member)
    guide.state.seat.arrived(1, "ready")
    member.state.seat.arrived(1, "ready")
    member.state.data_to_send()  # swallowed
    member.cut()
    settle(guide, member)
    assert guide.heard(Gathered) == []
    member.connect()
    settle(guide, member)
    assert [(e.member, e.role) for e in member.heard(Joined)] == [(2, "member")] * 2
    assert len(member.heard(Gathering)) == 1
    (gathered,) = guide.heard(Gathered)
    assert (gathered.gathering, gathered.ready.tolist()) == (1, [1, 2])


def test_what_is_said_without_a_connection_is_said_later(two: tuple[Client, Client]) -> None:
    guide, member = two
    guide.cut()
    guide.state.seat.gather((1, 2, 3), 9.0)
    settle(guide, member)
    assert member.heard(Gathering) == []
    guide.connect()
    settle(guide, member)
    assert len(member.heard(Gathering)) == 1


def test_a_new_seat_counts_group_landings_anew(two: tuple[Client, Client]) -> None:
    """The server was replaced: numbers begin at 1, and mean other landings."""
    guide, member = two
    guide.state.seat.gather((1, 2, 3), 9.0)
    settle(guide, member)
    for client in two:
        client.state.seat.arrived(1, "ready")
    fresh = Groups(GroupLimits())
    for client in two:
        client.cut()
        client.groups = fresh
        client.connect()
    settle(guide, member)
    guide.state.seat.gather((7, 0, 0), 9.0)
    settle(guide, member)
    assert [e.position[0] for e in member.heard(Gathering)] == [1.0, 7.0]
    assert guide.heard(Gathered) == [], "what was said of the old one does not count"


def test_refused_and_left(two: tuple[Client, Client], welcome: Welcome) -> None:
    guide, member = two
    request = member.state.seat.gather((1, 2, 3), 9.0)
    settle(guide, member)
    (refused,) = member.heard(GroupRefused)
    assert (refused.request, refused.code) == (request, "group_refused")
    third = Client(guide.groups, "x", welcome)
    join_request = third.state.seat.join("tour", "guide")
    settle(guide, member, third)
    assert [e.request for e in third.heard(GroupRefused)] == [join_request]
    third.cut()
    third.connect()
    assert not any(isinstance(m, Join) for m in map(_c2s, third.state.data_to_send()))
    member.state.seat.leave()
    settle(guide, member)
    assert guide.groups.member_count == 1
    member.cut()
    member.connect()
    settle(guide, member)
    assert guide.groups.member_count == 1


def test_a_second_join_gives_the_first_seat_up_even_where_it_is_refused(
    two: tuple[Client, Client],
) -> None:
    guide, member = two
    member.state.seat.join("tour", "guide")
    settle(guide, member)
    assert guide.groups.member_count == 1


def test_names_are_checked_before_anything_is_sent(two: tuple[Client, Client]) -> None:
    guide, _ = two
    with pytest.raises(UsageError):
        guide.state.seat.join("../../etc", "guide")
    with pytest.raises(UsageError):
        guide.state.seat.join("tour", "owner")
    with pytest.raises(UsageError):
        guide.state.seat.gather((1, 2), 9.0)
    assert guide.state.data_to_send() == []


def _c2s(data: bytes | str) -> Any:
    return decode(data, Direction.CLIENT_TO_SERVER)
