"""Sessions in groups: refusals, and group messages that wait for a slow client."""

from __future__ import annotations

from typing import Any

from server.session_model import Client, aim, land, make_scene

from terraport_server.groups.groups import Groups
from terraport_server.groups.state import GroupLimits, Place
from terraport_server.session.interface import SendMessage, SessionLimits
from terraport_server.session.session import Session
from terraport_wire import (
    Arrived,
    Bye,
    Error,
    Gather,
    Gathering,
    Join,
    Joined,
    Leave,
    Message,
    Roster,
)


def wants(role: str = "member", group: str = "tour", seat: str | None = None) -> Join:
    return Join(request=1, group=group, role=role, seat=seat)


def gather_request(radius_m: float = 25.0) -> Gather:
    return Gather(request=2, position=(0.0, 0.0, 0.0), radius_m=radius_m)


class Port:
    """What the shell's door is, without an event loop."""

    def __init__(self, hall: Hall, number: int) -> None:
        self.hall, self.number = hall, number

    def join(self, join: Join, place: Place | None, now_s: float) -> str | None:
        self.hall.secrets += 1
        secret = f"s{self.hall.secrets}"
        refusal = self.hall.groups.join(
            self.number, "row", join, now_s, new_secret=secret, may_guide=True, place=place
        )
        self.hall.hand_out()
        return refusal

    def leave(self, now_s: float) -> None:
        self.hall.groups.leave(self.number, now_s)
        self.hall.hand_out()

    def gather(self, gather: Gather, now_s: float) -> str | None:
        refusal = self.hall.groups.gather(self.number, gather, now_s)
        self.hall.hand_out()
        return refusal

    def arrived(self, arrived: Arrived) -> None:
        self.hall.groups.arrived(self.number, arrived.gathering, arrived.state)
        self.hall.hand_out()

    def landed(self, place: Place, now_s: float) -> None:
        self.hall.groups.landed(self.number, place, now_s)
        self.hall.hand_out()


class Hall:
    """Some clients, each with a session, and the groups that they share."""

    def __init__(self) -> None:
        self.groups = Groups(GroupLimits(group_absence_s=5.0, group_deadline_s=9.0))
        self.secrets = self.count = 0
        self.clients: dict[int, Client] = {}
        self.now_s = 0.0

    def open(self) -> Client:
        self.count += 1
        scene = make_scene(12)
        session = Session(
            scene,
            SessionLimits(max_messages_per_s=1e6),
            session_id=f"s{self.count}",
            now_s=self.now_s,
            groups=Port(self, self.count),
        )
        client = self.clients[self.count] = Client(session, scene)
        client.now_s = self.now_s
        client.greet()
        return client

    def hand_out(self) -> None:
        for number, message in self.groups.take_posts():
            assert isinstance(number, int)
            self.clients[number].session.tell_group(message)

    def wait(self, seconds: float) -> None:
        self.now_s += seconds
        self.groups.tick(self.now_s)
        self.hand_out()
        for client in self.clients.values():
            client.now_s = self.now_s


def heard(client: Client, kind: type[Message]) -> list[Any]:
    client.run()
    return [message for message in client.messages if isinstance(message, kind)]


def test_a_member_stands_where_its_last_landing_was_taken() -> None:
    hall = Hall()
    guide, member = hall.open(), hall.open()
    guide.tell(wants("guide"))
    member.tell(land(1, 3.0))
    member.tell(wants())
    hall.wait(1.0)
    assert [one.position for one in heard(guide, Roster)[-1].members] == [None, (3.0, 0.0, 0.0)]
    member.tell(land(2, 5.0))
    member.tell(land(3, 7.0, 1e6))  # refused: too large
    member.tell(aim(4, 9.0))
    hall.wait(1.0)
    assert [one.position for one in heard(guide, Roster)[-1].members] == [None, (5.0, 0.0, 0.0)]


def test_a_draining_server_takes_nobody_in() -> None:
    hall = Hall()
    client = hall.open()
    client.tell(land(1))
    client.session.drain(0.0, 10.0)
    client.tell(wants())
    (error,) = heard(client, Error)
    assert "goes away" in error.message
    assert hall.groups.member_count == 0


def test_a_member_that_reads_nothing_holds_the_newest_of_each_alone() -> None:
    hall = Hall()
    guide, slow = hall.open(), hall.open()
    guide.tell(wants("guide"))
    slow.tell(wants())
    heard(guide, Message)
    for _ in range(500):
        guide.tell(gather_request())
        guide.tell(Arrived(gathering=1, state="ready"))
        hall.wait(0.3)
        passing = hall.open()
        passing.tell(wants())
        passing.tell(Bye())
        heard(guide, Message)
    kinds = []
    while (action := slow.session.next_action()) is not None:
        assert isinstance(action, SendMessage)
        kinds.append(type(action.message))
    assert kinds[0] is Joined
    assert sorted(kind.__name__ for kind in kinds[1:]) == ["Gathering", "Roster"]


def test_after_leaving_nothing_more_is_told() -> None:
    hall = Hall()
    guide, member = hall.open(), hall.open()
    guide.tell(wants("guide"))
    member.tell(wants())
    guide.tell(gather_request())
    member.tell(Leave())
    assert heard(member, Gathering) == heard(member, Roster) == []


def test_group_messages_go_before_payload() -> None:
    hall = Hall()
    guide, member = hall.open(), hall.open()
    guide.tell(wants("guide"))
    member.tell(wants())
    member.run()
    member.tell(land(1))
    member.run(most=2)
    guide.tell(gather_request())
    seen = member.run(most=1)
    assert isinstance(seen[0], Gathering)
