"""Homes of groups: the same for everybody, kept while there are members, few moves."""

from __future__ import annotations

from terraport_server.group_homes import GroupHomes

SERVING = [(0, "a"), (1, "b"), (2, "c")]
NAMES = [f"tour-{number}" for number in range(300)]


def test_every_name_has_one_home_whatever_the_order_asked_in() -> None:
    homes: GroupHomes[str] = GroupHomes()
    first = {name: homes.home_of(name, SERVING) for name in NAMES}
    assert first == {name: homes.home_of(name, SERVING[::-1]) for name in NAMES}
    counts = [list(first.values()).count(worker) for worker in "abc"]
    assert sum(counts) == 300
    assert min(counts) > 60


def test_when_a_worker_goes_only_its_groups_move() -> None:
    homes: GroupHomes[str] = GroupHomes()
    for name in NAMES:
        before, after = homes.home_of(name, SERVING), homes.home_of(name, SERVING[:2])
        assert after == before if before != "c" else after in {"a", "b"}


def test_a_group_with_members_stays_when_a_worker_comes_back() -> None:
    homes: GroupHomes[str] = GroupHomes()
    name = next(name for name in NAMES if homes.home_of(name, SERVING) == "c")
    stand_in = homes.home_of(name, SERVING[:2])
    assert stand_in is not None
    homes.tell(stand_in, [name])
    assert homes.home_of(name, SERVING) == stand_in
    homes.tell(stand_in, [])
    assert homes.home_of(name, SERVING) == "c"


def test_the_groups_of_a_worker_that_is_gone_meet_elsewhere() -> None:
    homes: GroupHomes[str] = GroupHomes()
    homes.tell("a", ["x", "y"])
    homes.forget("a")
    assert homes.home_of("x", [(1, "b")]) == "b"
    homes.forget("never heard of")


def test_the_first_worker_that_has_a_group_is_its_home() -> None:
    """Two can have it for a moment: its home left, and its members have not all noticed."""
    homes: GroupHomes[str] = GroupHomes()
    homes.tell("a", ["x"])
    homes.tell("b", ["x"])
    assert homes.home_of("x", SERVING) == "a"
    homes.tell("b", [])
    assert homes.home_of("x", SERVING) == "a"


def test_nobody_serves() -> None:
    homes: GroupHomes[str] = GroupHomes()
    assert homes.home_of("x", []) is None
