"""Groups as a pure state machine: seats, group landings, barriers, and any history at all."""

from __future__ import annotations

from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from terraport_server.groups.groups import Groups
from terraport_server.groups.state import GroupLimits
from terraport_wire import Gather, Gathered, Gathering, Join, Joined, Message, Roster


def wants(role: str = "member", *, group: str = "tour", seat: str | None = None) -> Join:
    return Join(request=1, group=group, role=role, name="N", seat=seat)


def gather_request(deadline_ms: int | None = None) -> Gather:
    return Gather(
        request=2,
        position=(1.0, 2.0, 3.0),
        radius_m=9.0,
        inner_radius_m=4.0,
        deadline_ms=deadline_ms,
    )


class Hall:
    """Groups, and what was told to whom."""

    def __init__(self, **limits: Any) -> None:
        self.groups = Groups(GroupLimits(**limits))
        self.inboxes: dict[str, list[Message]] = {}
        self.now_s = 0.0
        self.secrets = 0
        self.owner = "school"

    def join(self, key: str, join: Join | None = None, **options: Any) -> str | None:
        self.secrets += 1
        return self.groups.join(
            key,
            options.pop("scene", "pit"),
            join or wants(**options),
            self.now_s,
            new_secret=f"secret-{self.secrets}",
            may_guide=True,
            owner=options.get("owner", self.owner),
            place=options.get("place"),
        )

    def hear(self) -> dict[str, list[Message]]:
        """Everything told since the last call."""
        messages: dict[str, list[Message]] = {}
        for key, message in self.groups.take_messages():
            messages.setdefault(str(key), []).append(message)
        return messages

    def wait(self, seconds: float) -> dict[str, list[Message]]:
        self.now_s += seconds
        self.groups.tick(self.now_s)
        return self.hear()


def filled(*members: str, **limits: Any) -> tuple[Hall, dict[str, str]]:
    """A hall with a guide "g" and members; their secrets by key."""
    hall = Hall(**limits)
    secrets = {}
    for key in ("g", *members):
        assert hall.join(key, role="guide" if key == "g" else "member") is None
        (joined,) = [m for m in hall.hear()[key] if isinstance(m, Joined)]
        secrets[key] = joined.seat
    hall.wait(1.0)
    return hall, secrets


def of(inboxes: dict[str, list[Message]], kind: type[Message]) -> dict[str, Any]:
    """The last message of a kind by key."""
    return {key: m for key, inbox in inboxes.items() for m in inbox if isinstance(m, kind)}


def test_joined_is_told_to_one_and_the_roster_to_all() -> None:
    hall = Hall()
    hall.join("g", role="guide")
    hall.hear()
    hall.join("a")
    messages = hall.hear()
    assert messages["a"][0] == Joined(
        request=1, group="tour", member=2, role="member", seat="secret-2"
    )
    messages = hall.wait(1.0)
    for key in ("g", "a"):
        (roster,) = messages[key]
        assert isinstance(roster, Roster)
        assert [(m.member, m.role, m.present) for m in roster.members] == [
            (1, "guide", True),
            (2, "member", True),
        ]
        assert "secret" not in repr(roster)


def places(inbox: list[Message]) -> list[tuple[float, float, float] | None]:
    """Where everybody stands, as the last roster has it."""
    return [m.position for m in [r for r in inbox if isinstance(r, Roster)][-1].members]


def test_a_seat_that_is_taken_again_stands_where_it_was() -> None:
    hall, secrets = filled("a")
    hall.groups.landed("a", (1.0, 2.0, 3.0), hall.now_s)
    hall.groups.lost("a", hall.now_s)
    assert places(hall.wait(1.0)["g"]) == [None, (1.0, 2.0, 3.0)]
    hall.join("a2", wants(seat=secrets["a"]))
    assert places(hall.wait(1.0)["g"]) == [None, (1.0, 2.0, 3.0)]
    hall.join("a3", wants(seat=secrets["a"]), place=(4.0, 5.0, 6.0))
    assert places(hall.wait(1.0)["g"]) == [None, (4.0, 5.0, 6.0)]


def test_landings_alone_cost_each_member_one_roster_a_second() -> None:
    hall, _ = filled("a", "b")
    heard = 0
    for step in range(400):  # ten seconds; three members land forty times a second each
        for key in ("g", "a", "b"):
            hall.groups.landed(key, (float(step), 0.0, 0.0), hall.now_s)
        heard += len(hall.hear().get("b", []))
        heard += len(hall.wait(0.025).get("b", []))
    assert 9 <= heard <= 10
    # The newest places are not lost, and to land there again tells nothing.
    last = hall.wait(1.0)
    assert places(last["b"]) == [(399.0, 0.0, 0.0)] * 3
    hall.groups.landed("a", (399.0, 0.0, 0.0), hall.now_s)
    assert hall.wait(5.0) == {}
    assert hall.groups.wake_at_s() is None


def test_the_guide_lands_everybody_and_the_barrier_opens_when_all_are_ready() -> None:
    hall, _ = filled("a", "b")
    assert hall.groups.gather("g", gather_request(), hall.now_s) is None
    messages = of(hall.hear(), Gathering)
    assert set(messages) == {"g", "a", "b"}
    assert (messages["a"].gathering, messages["a"].guide, messages["a"].left_ms) == (1, 1, 60_000)
    assert (messages["a"].position, messages["a"].inner_radius_m) == ((1.0, 2.0, 3.0), 4.0)
    for key in ("b", "g"):
        hall.groups.arrived(key, 1, "ready")
    hall.groups.arrived("a", 1, "degraded")
    assert hall.hear() == {}, "a degraded member is waited for until the deadline"
    hall.groups.arrived("a", 1, "ready")
    messages = of(hall.hear(), Gathered)
    assert set(messages) == {"g", "a", "b"}
    assert messages["b"].ready.tolist() == [1, 2, 3]
    hall.groups.arrived("a", 1, "degraded")
    assert hall.wait(1000.0) == {}, "the barrier opens once"


def test_the_deadline_opens_the_barrier_and_says_who_is_where() -> None:
    hall, _ = filled("a", "b", "c")
    hall.groups.gather("g", gather_request(5000), hall.now_s)
    hall.groups.arrived("g", 1, "ready")
    hall.groups.arrived("a", 1, "degraded")
    hall.groups.arrived("b", 1, "declined")
    hall.hear()
    assert hall.groups.wake_at_s() == hall.now_s + 5.0
    assert hall.wait(4.9) == {}
    opened = of(hall.wait(0.2), Gathered)["c"]
    assert (opened.ready.tolist(), opened.degraded.tolist()) == ([1], [2])
    assert opened.missing.tolist() == [3, 4]
    assert hall.groups.wake_at_s() is None


def test_a_lost_member_is_waited_for_a_while_then_left() -> None:
    hall, _ = filled("a", group_absence_s=10.0)
    hall.groups.gather("g", gather_request(), hall.now_s)
    hall.groups.arrived("g", 1, "ready")
    hall.groups.lost("a", hall.now_s)
    messages = hall.wait(0.5)
    assert [m.present for m in of(messages, Roster)["g"].members] == [True, False]
    assert of(hall.wait(9.4), Gathered) == {}
    assert of(hall.wait(0.2), Gathered)["g"].missing.tolist() == []


def test_a_seat_is_taken_again_by_its_secret_with_its_place_in_the_barrier() -> None:
    hall, secrets = filled("a")
    hall.groups.gather("g", gather_request(), hall.now_s)
    hall.groups.arrived("a", 1, "ready")
    hall.groups.lost("g", hall.now_s)
    hall.wait(20.0)
    assert hall.join("g2", wants("guide", seat=secrets["g"])) is None
    messages = hall.hear()
    assert of(messages, Joined)["g2"].member == 1
    assert of(messages, Joined)["g2"].role == "guide"
    assert of(messages, Gathering)["g2"].left_ms == 40_000
    hall.groups.arrived("g2", 1, "ready")
    assert of(hall.hear(), Gathered)["g2"].ready.tolist() == [1, 2]


def test_a_seat_moves_from_a_connection_that_only_looks_alive() -> None:
    hall, secrets = filled("a")
    hall.join("a2", wants(seat=secrets["a"]))
    assert of(hall.hear(), Joined)["a2"].member == 2
    hall.groups.lost("a", hall.now_s)  # noticed later
    hall.groups.leave("a", hall.now_s)
    assert hall.groups.member_count == 2
    hall.groups.gather("g", gather_request(), hall.now_s)
    assert set(of(hall.hear(), Gathering)) == {"g", "a2"}


def test_however_often_a_guide_gathers_members_hear_of_it_four_times_a_second() -> None:
    hall, _ = filled("a", "b")
    heard = list[int]()
    for _ in range(100):
        hall.groups.gather("g", gather_request(), hall.now_s)
        heard += [m.gathering for m in of(hall.wait(0.01), Gathering).values()]
    assert 4 * 3 <= len(heard) <= 5 * 3, "of each of three, in a second"
    heard += [m.gathering for m in of(hall.wait(0.25), Gathering).values()]
    assert heard[-1] == 100, "the newest is told in the end"


def test_nobody_hears_that_a_gathering_is_over_before_that_it_began() -> None:
    hall, _ = filled("a")
    for _ in range(2):
        hall.groups.gather("g", gather_request(deadline_ms=50), hall.now_s)
    hall.hear()
    assert [type(m) for m in hall.wait(0.06)["a"]] == [Gathering, Gathered]


def test_refusals() -> None:
    hall, _ = filled("a", max_groups=2, max_group_members=3)
    assert "from a member" in (hall.groups.gather("a", gather_request(), 0.0) or "")
    assert "without a seat" in (hall.groups.gather("x", gather_request(), 0.0) or "")
    assert "that has one" in (hall.join("x", role="guide") or "")
    assert hall.join("b") is None
    assert "at most 3" in (hall.join("c") or "")
    assert hall.join("c", group="other") is None
    assert "at most 2" in (hall.join("d", group="third") or "")
    assert hall.join("c", group="third") is None, "its own group goes with it"
    refused = hall.groups.join(
        "y", "pit", wants("guide", group="third"), 0.0, new_secret="s", may_guide=False
    )
    assert "does not allow" in (refused or "")


def test_a_refused_join_keeps_the_seat_held_before() -> None:
    hall, _ = filled("a")
    hall.join("x", group="other", role="guide")
    assert hall.join("a", group="other", role="guide") is not None
    hall.groups.gather("g", gather_request(), hall.now_s)
    assert "a" in of(hall.hear(), Gathering)


def test_who_comes_and_goes_takes_only_his_own_places() -> None:
    """64 groups begun and dropped in a second kept everybody out for `group_absence_s`."""
    hall = Hall(max_groups=6, max_groups_per_client=3)
    hall.owner = "honest"
    assert hall.join("h", group="tour") is None
    hall.join("lost", group="expected-back")
    hall.groups.lost("lost", 0.0)
    hall.owner = "attacker"
    for number in range(50):
        assert hall.join(f"a{number}", group=f"g{number}") is None
        hall.groups.lost(f"a{number}", 0.0)
    assert hall.groups.group_count == 5  # his own first ones went
    hall.owner = "another"
    for number in range(3):
        assert hall.join(f"b{number}", group=f"b{number}") is None
    assert hall.groups.group_count == 6  # the first of whom most is absent, not who is alone
    hall.owner = "honest"
    assert "secret-2" in [one.seat for one in joined_by(hall, "lost", "expected-back", "secret-2")]


def joined_by(hall: Hall, key: str, group: str, secret: str) -> list[Joined]:
    hall.hear()
    hall.join(key, wants(group=group, seat=secret))
    return [message for message in hall.hear()[key] if isinstance(message, Joined)]


def test_who_is_there_does_not_give_way() -> None:
    hall = Hall(max_groups=3, max_groups_per_client=2)
    for number in range(2):
        assert hall.join(f"a{number}", group=f"a{number}") is None
    assert "at most 2 of one address and token" in (hall.join("a2", group="a2") or "")
    hall.owner = "another"
    assert hall.join("b", group="b") is None
    assert "at most 3 on this server" in (hall.join("c", group="c") or "")
    assert hall.join("b", group="c") is None, "its own group goes with it"


def test_in_a_full_group_a_lost_seat_gives_way() -> None:
    hall = Hall(max_group_members=4)
    hall.join("honest", role="guide")
    hall.join("lost")
    hall.groups.lost("lost", 0.0)
    hall.owner = "attacker"
    for number in range(9):
        assert hall.join(f"a{number}") is None
        hall.groups.lost(f"a{number}", 1.0)
    hall.owner = "another"
    assert hall.join("b") is None
    assert joined_by(hall, "lost", "tour", "secret-2")[0].seat == "secret-2"
    assert hall.join("c") is None
    assert "got member 5" in (hall.join("d") or "")


class AnyHistory(RuleBasedStateMachine):
    """Keys 0..5 join, leave, get lost, gather and arrive; time passes."""

    keys = st.integers(0, 5)

    @initialize()
    def begin(self) -> None:
        self.hall = Hall(
            max_groups=2,
            max_groups_per_client=1,
            max_group_members=3,
            group_absence_s=4.0,
            group_deadline_s=9.0,
        )
        self.membership: dict[int, tuple[str, int]] = {}
        self.seats: dict[tuple[str, int], str] = {}
        self.shut: dict[str, tuple[int, float]] = {}
        self.opened: set[tuple[str, int]] = set()

    def listen(self) -> None:
        for key, message in self.hall.groups.take_messages():
            assert isinstance(key, int)
            if isinstance(message, Joined):
                self.membership = {
                    k: p for k, p in self.membership.items() if p != (message.group, message.member)
                }
                self.membership[key] = (message.group, message.member)
                if message.member == 1 and self.seats.get((message.group, 1)) != message.seat:
                    self.shut.pop(message.group, None)  # the first of a new group of that name
                self.seats[message.group, message.member] = message.seat
            group = self.membership[key][0]
            if isinstance(message, Roster):
                assert message.group == group
                assert 1 <= len(message.members) <= 3
                assert sum(m.role == "guide" for m in message.members) <= 1
            elif isinstance(message, Gathering) and message.left_ms is not None:
                assert message.left_ms <= 9000
                self.shut[group] = (message.gathering, self.hall.now_s + message.left_ms / 1000.0)
            elif isinstance(message, Gathered):
                numbers = [
                    *message.ready.tolist(), *message.degraded.tolist(), *message.missing.tolist()
                ]  # fmt: skip
                assert len(set(numbers)) == len(numbers)
                assert self.membership[key][1] in numbers
                self.shut.pop(group, None)

    @rule(
        key=keys,
        group=st.sampled_from("xyz"),
        role=st.sampled_from(["guide", "member"]),
        returns=st.booleans(),
        number=st.integers(1, 3),
    )
    def join(self, key: int, group: str, role: str, returns: bool, number: int) -> None:
        seat = self.seats.get((group, number)) if returns else None
        self.hall.secrets += 1
        refused = self.hall.groups.join(
            key,
            "pit",
            wants(role, group=group, seat=seat),
            self.hall.now_s,
            new_secret=f"s{self.hall.secrets}",
            may_guide=True,
            owner=key % 2,
        )
        if refused is None:
            self.membership.pop(key, None)
        self.listen()

    @rule(key=keys, how=st.sampled_from(["leave", "lost"]))
    def go(self, key: int, how: str) -> None:
        getattr(self.hall.groups, how)(key, self.hall.now_s)
        self.membership.pop(key, None)
        self.listen()

    @rule(key=keys, wait_ms=st.none() | st.integers(1, 20_000))
    def gather(self, key: int, wait_ms: int | None) -> None:
        self.hall.groups.gather(key, gather_request(wait_ms), self.hall.now_s)
        self.listen()

    @rule(
        key=keys, number=st.integers(1, 3), state=st.sampled_from(["ready", "degraded", "declined"])
    )
    def arrive(self, key: int, number: int, state: str) -> None:
        self.hall.groups.arrived(key, number, state)
        self.listen()

    @rule(seconds=st.floats(0.01, 5.0))
    def wait(self, seconds: float) -> None:
        due_s = self.hall.groups.wake_at_s()
        self.hall.now_s += seconds
        if due_s is not None and due_s <= self.hall.now_s:
            self.hall.groups.tick(self.hall.now_s)
        self.listen()

    @invariant()
    def nobody_is_held_beyond_the_deadline(self) -> None:
        if not hasattr(self, "hall"):
            return
        groups = self.hall.groups
        assert groups.group_count <= 2
        assert groups.member_count <= 6
        present = {group for group, _ in self.membership.values()}
        for group, (_, due_s) in self.shut.items():
            assert group not in present or due_s > self.hall.now_s - 1e-3
        due_s = groups.wake_at_s()
        assert due_s is None or groups.group_count > 0


AnyHistory.TestCase.settings = settings(max_examples=40, stateful_step_count=25)
TestAnyHistory = AnyHistory.TestCase


def test_a_history_that_chance_found() -> None:
    """A guide alone gathers, and joins the same name anew: another group, with no barrier."""
    history = AnyHistory()
    history.begin()
    history.join(0, "x", "guide", returns=False, number=1)
    history.gather(0, 1)
    history.join(0, "x", "guide", returns=False, number=1)
    history.wait(1.0)
    history.nobody_is_held_beyond_the_deadline()
    assert history.shut == {}


def test_who_comes_late_is_told_where_the_group_is() -> None:
    hall, _ = filled()
    hall.groups.gather("g", gather_request(), hall.now_s)
    hall.join("a")
    assert of(hall.hear(), Gathering)["a"].left_ms == 60_000
    hall.groups.arrived("g", 1, "ready")
    assert of(hall.hear(), Gathered) == {}, "it is expected"
    hall.groups.arrived("a", 1, "ready")
    hall.hear()
    hall.join("b")
    assert of(hall.hear(), Gathering)["b"].left_ms is None
