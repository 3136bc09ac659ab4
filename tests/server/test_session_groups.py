"""Sessions in groups: what is refused, what waits, and any history of members and landings."""

from __future__ import annotations

from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from server.session_model import Client, aim, assert_fatal, land, make_client, make_scene

from terraport_server.groups.groups import Groups
from terraport_server.groups.state import GroupLimits, Place
from terraport_server.session.interface import SendMessage, SessionLimits
from terraport_server.session.session import Session
from terraport_wire import (
    Arrived,
    Bye,
    CloseCode,
    Credit,
    Error,
    ErrorCode,
    Gather,
    Gathered,
    Gathering,
    Join,
    Joined,
    Leave,
    Message,
    Plan,
    Ready,
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


def test_without_groups_a_join_is_refused_and_the_session_goes_on() -> None:
    client = make_client()
    client.tell(wants())
    client.tell(Leave())
    client.tell(Arrived(gathering=1, state="ready"))
    client.tell(land(1))
    error, plan, *_ = client.run()
    assert (error.code, error.request, error.fatal) == ("group_refused", 1, False)
    assert "no groups are served here" in error.message
    assert isinstance(plan, Plan)


def test_group_messages_before_hello_are_fatal() -> None:
    client = make_client(greet=False)
    client.tell(wants())
    assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)


def test_a_radius_beyond_the_servers_is_refused() -> None:
    hall = Hall()
    guide = hall.open()
    guide.tell(wants("guide"))
    guide.tell(gather_request(501.0))
    (error,) = heard(guide, Error)
    assert (error.code, error.request) == ("group_refused", 2)
    assert "at most 500" in error.message


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


def test_bye_gives_the_seat_up_at_once() -> None:
    hall = Hall()
    client = hall.open()
    client.tell(wants())
    assert hall.groups.member_count == 1
    client.tell(Bye())
    assert hall.groups.member_count == 0


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


class AnyHistory(RuleBasedStateMachine):
    """Members land, aim, join, gather, arrive, leave and vanish; every session keeps the rules.

    ``Client`` of the session model checks each session's landings on the way.
    """

    which = st.integers(0, 3)

    @initialize()
    def begin(self) -> None:
        self.hall = Hall()
        self.live = [self.hall.open() for _ in range(4)]
        self.numbers = [1, 2, 3, 4]
        self.generation = 0
        self.seats: list[str] = []

    @rule(
        which=which,
        role=st.sampled_from(["guide", "member"]),
        group=st.sampled_from("xy"),
        again=st.booleans(),
    )
    def join(self, which: int, role: str, group: str, again: bool) -> None:
        seat = self.seats[-1] if again and self.seats else None
        self.live[which].tell(wants(role, group, seat))

    @rule(which=which)
    def leave(self, which: int) -> None:
        self.live[which].tell(Leave())

    @rule(which=which)
    def gather(self, which: int) -> None:
        self.live[which].tell(gather_request())

    @rule(which=which, x=st.integers(0, 120), wish=st.sampled_from([land, aim]))
    def move(self, which: int, x: int, wish: Any) -> None:
        self.generation += 1
        self.live[which].tell(wish(self.generation, float(x)))

    @rule(which=which, state=st.sampled_from(["ready", "degraded", "declined"]))
    def arrive(self, which: int, state: str) -> None:
        calls = heard(self.live[which], Gathering)
        if calls:
            self.live[which].tell(Arrived(gathering=calls[-1].gathering, state=state))

    @rule(which=which, most=st.integers(1, 6))
    def read(self, which: int, most: int) -> None:
        self.live[which].run(most=most)
        self.seats += [m.seat for m in self.live[which].messages[-most:] if isinstance(m, Joined)]

    @rule(which=which, polite=st.booleans())
    def vanish(self, which: int, polite: bool) -> None:
        """Go, and come back as a new connection."""
        if polite:
            self.live[which].tell(Bye())
        self.hall.groups.lost(self.numbers[which], self.hall.now_s)
        self.hall.hand_out()
        self.live[which] = self.hall.open()
        self.numbers[which] = self.hall.count

    @rule(seconds=st.floats(0.1, 6.0))
    def wait(self, seconds: float) -> None:
        self.hall.wait(seconds)

    @invariant()
    def what_waits_is_bounded_and_nobody_is_closed(self) -> None:
        if not hasattr(self, "hall"):
            return
        assert self.hall.groups.member_count <= 4 + self.hall.count
        for client in self.live:
            assert client.close is None

    def teardown(self) -> None:
        if not hasattr(self, "hall"):
            return
        self.hall.wait(20.0)
        for client in self.live:
            client.credit += 1 << 20
            client.tell(Credit(bytes=1 << 20))
            client.run()
            plans = [m for m in client.messages if isinstance(m, Plan)]
            ready = [m.generation for m in client.messages if isinstance(m, Ready)]
            assert not plans or plans[-1].generation in ready
            opened = [m.gathering for m in client.messages if isinstance(m, Gathered)]
            assert len(opened) <= len(client.messages)
        self.hall.wait(1.0)  # two seats lost at once are told of one after the other
        assert self.hall.groups.wake_at_s() is None, "no barrier and no lost seat is left"


AnyHistory.TestCase.settings = settings(max_examples=40, stateful_step_count=25)
TestAnyHistory = AnyHistory.TestCase
