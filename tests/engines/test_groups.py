"""Groups of a client's core and the Python SDK, on the real service: led, leading, staying, cut."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from engines.programs import Client, Landed, ThreadedProxy
from faults.service import Service

import terraport.sync

HERE = (30.0, 1.0, 30.0, 22.0)
THERE = (12.0, 1.0, 44.0, 15.0)
WAIT_S = 60.0


def steps(kind: str, place: tuple[float, ...]) -> str:
    return f"{kind}:{','.join(map(str, place))}"


def beside(work: Callable[[], Any], run: Callable[[], Landed]) -> tuple[Any, Landed]:
    """Run a program while something else happens; return what came of both."""
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(work)
        landed = run()
        return other.result(WAIT_S), landed


@pytest.mark.parametrize("threaded", [0, 1], ids=["pumped", "threaded"])
def test_who_follows_shows_what_the_guide_shows(
    client: Client, server: Service, threaded: int
) -> None:
    """It lands where the SDK's guide lands everybody, and the barrier counts it."""
    (arrivals, visible), landed = led(client, server, f"led-{threaded}", threaded=threaded)
    own = landed.of("group_joined")[0]["member"]
    assert own in arrivals.ready
    assert len(arrivals.ready) == 2
    assert landed.stage["visible"] == visible
    people = landed.of("group_roster")[-1]["members"]
    # The last list that it heard has its seat; where it stands is told after its landing.
    assert [own, "Bo", "member", True] in [one[:4] for one in people]
    (called,) = landed.of("group_called")
    place = [*called["gathering"]["position"], called["gathering"]["radius_m"]]
    assert place == list(HERE)
    assert not called["gathering"]["over"]


def test_who_does_not_follow_stays_and_holds_nobody_up(client: Client, server: Service) -> None:
    (arrivals, visible), landed = led(client, server, "stays", "follow:0")
    assert list(arrivals.missing) == [landed.of("group_joined")[0]["member"]]
    assert visible
    assert landed.stage["visible"] == []


def led(
    client: Client, server: Service, name: str, *before: str, threaded: int = 0
) -> tuple[Any, Landed]:
    """Let the SDK guide a group that the client is in; who arrived and what it shows, as told."""
    url = f"{server.url}/scenes/grid"
    group_name = f"{name}-{client.language}"

    def lead() -> tuple[Any, list[int]]:
        with terraport.sync.connect(url) as session:
            group = session.join_group(group_name, role="guide", name="Ada")
            group.members_present(2, timeout_s=WAIT_S)
            there = group.land_group(HERE[:3], HERE[3])
            there.land().ready()
            return there.all_there(timeout_s=WAIT_S), sorted(session.visible)

    steps = [*before, f"join:{group_name},member,Bo", "barrier:1"]
    came, landed = beside(lead, lambda: client.land(url, *steps, staged=1, threaded=threaded))
    assert (landed.exit_code, landed.failure) == (0, None), landed.output
    return came, landed


@pytest.mark.parametrize("threaded", [0, 1], ids=["pumped", "threaded"])
def test_who_guides_takes_the_sdk_along(client: Client, server: Service, threaded: int) -> None:
    url = f"{server.url}/scenes/grid"
    name = f"leading-{client.language}-{threaded}"

    def follow() -> tuple[list[int], tuple[float, ...], int]:
        with terraport.sync.connect(url) as session:
            group = session.join_group(name)
            call = next(iter(group))
            call.land().ready()
            arrivals = call.all_there(timeout_s=WAIT_S)
            return list(arrivals.ready), (*call.position, call.radius_m), group.member

    (ready, place, member), landed = beside(
        follow,
        lambda: client.land(
            url,
            f"join:{name},guide",
            "people:2",
            steps("gather", HERE),
            "barrier:1",
            staged=1,
            threaded=threaded,
        ),
    )
    assert (landed.exit_code, landed.failure) == (0, None), landed.output
    assert place == HERE
    assert sorted(ready) == sorted([landed.of("group_joined")[0]["member"], member])
    assert landed.of("group_gathered")[0]["gathering"]["ready"] == sorted(ready)


def test_a_seat_outlives_a_cut_line(client: Client, server: Service) -> None:
    """The same number, and the next landing of the group counts it."""
    name = f"cut-{client.language}"
    with ThreadedProxy(server.url) as line:

        def lead() -> list[int]:
            with terraport.sync.connect(f"{server.url}/scenes/grid") as session:
                group = session.join_group(name, role="guide")
                group.members_present(2, timeout_s=WAIT_S)
                # Both have their seats: the other one says so by being there.
                there = group.land_group(THERE[:3], THERE[3])
                there.land().ready()
                there.all_there(timeout_s=WAIT_S)
                line.cut()
                there = group.land_group(HERE[:3], HERE[3])
                there.land().ready()
                return list(there.all_there(timeout_s=WAIT_S).ready)

        ready, landed = beside(
            lead,
            lambda: client.land(
                f"{line.url}/scenes/grid", f"join:{name},member", "barrier:2", staged=1
            ),
        )
    assert (landed.exit_code, landed.failure) == (0, None), landed.output
    seats = {joined["member"] for joined in landed.of("group_joined")}
    assert len(landed.of("group_joined")) == 2
    assert len(seats) == 1
    assert seats < set(ready)


def test_what_cannot_be_is_refused(client: Client, server: Service) -> None:
    """A second guide, a landing by somebody else; and a name that the protocol has not."""
    url = f"{server.url}/scenes/grid"
    with terraport.sync.connect(url) as session:
        session.join_group(f"taken-{client.language}", role="guide")
        second = client.land(url, f"join:taken-{client.language},guide")
        member = client.land(url, f"join:taken-{client.language},member", steps("gather", HERE))
    assert (second.exit_code, second.failure) == (
        1,
        f"join:taken-{client.language},guide: refused: group_refused",
    )
    assert member.failure == f"{steps('gather', HERE)}: refused: group_refused"
    assert [one["code"] for one in member.of("group_refused")] == ["group_refused"]
