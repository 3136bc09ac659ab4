"""The state machine of a session: any history against brute force, and single rules."""

from __future__ import annotations

import random
from collections import deque
from typing import Any

import numpy as np
import pytest
from server.landing_client import LandingClient
from server.plain_client import make_hello, make_land

from terraport_payload import Cover, box_distances_m
from terraport_payload.hidden import HiddenFaces
from terraport_server.session.interface import (
    Close,
    MakePlan,
    Observer,
    RunPick,
    SceneView,
    SegmentTable,
    SendChunk,
    SendMessage,
    SessionLimits,
)
from terraport_server.session.session import Session
from terraport_wire import (
    FOLLOWS,
    Arrived,
    Budgets,
    Bye,
    CloseCode,
    Credit,
    Direction,
    Error,
    FieldError,
    Frame,
    Gather,
    Gathering,
    Join,
    Joined,
    Leave,
    Message,
    Notice,
    Pick,
    Plan,
    Prefetch,
    Ready,
    Roster,
    Unknown,
    Welcome,
    decode,
    encode,
)

COUNT = 40
CENTRE = (50.0, 50.0, 50.0)


def make_scene(seed: int, levels: int = 1) -> tuple[SceneView, Cover]:
    """Random boxes in 100 m, payloads of 1 to 400 bytes, and a random cover of 64 base faces."""
    rng = np.random.default_rng(seed)
    low = rng.uniform(0, 100, (COUNT, 3))
    bounds = np.concatenate([low, low + rng.uniform(0, 20, (COUNT, 3))], axis=1)
    rows = COUNT * levels
    table = SegmentTable(
        bounds=bounds.astype(np.float32),
        lengths=rng.integers(1, 400, rows).astype(np.uint32),
        hashes=rng.permutation(np.arange(rows, dtype=np.uint64) + 7_000),
        faces=rng.integers(1, 50, rows).astype(np.uint32),
        vertices=rng.integers(3, 50, rows).astype(np.uint32),
        texture_bytes=np.zeros(rows, np.uint64),
        levels=levels,
    )
    over = [np.unique(rng.integers(0, COUNT, rng.integers(0, 4))) for _ in range(64)]
    offsets = np.cumsum([0, *map(len, over)]).astype(np.uint32)
    cover = Cover(offsets, np.concatenate(over).astype(np.uint32))

    def within(centre: Any, radius_m: float) -> Any:
        return np.flatnonzero(box_distances_m(table.bounds, centre) <= radius_m)

    scene = SceneView(
        id="pit",
        version="1" * 32,
        name="Pit",
        table=table,
        within=within,
        hidden_faces=HiddenFaces(cover, COUNT),
    )
    return scene, cover


def payload_of(table: SegmentTable, row: int) -> bytes:
    """Return bytes that tell one payload from others."""
    return (int(table.hashes[row]).to_bytes(8, "little") * 50)[: int(table.lengths[row])]


def expected(
    scene: SceneView,
    position: Any,
    radius_m: float,
    *,
    coarse_radius_m: float | None = None,
    without: set[int] | None = None,
    budgets: Budgets | None = None,
    inner_radius_m: float | None = None,
) -> list[tuple[int, bool]]:
    """Return segment and level of a plan by a loop over the scene (section 4, rules 1 and 2)."""
    del inner_radius_m
    table = scene.table
    distances = box_distances_m(table.bounds, position)
    rows = []
    for segment in sorted(range(COUNT), key=lambda one: (distances[one], one)):
        coarser = distances[segment] > radius_m
        if coarser and not (
            table.levels > 1
            and coarse_radius_m is not None
            and distances[segment] <= coarse_radius_m
        ):
            continue
        row = segment + COUNT * coarser
        if int(table.hashes[row]) not in (without or ()):
            rows.append(row)
    budgets = budgets or Budgets()
    faces = payload_bytes = 0
    shown = []
    for row in rows:
        faces += int(table.faces[row])
        payload_bytes += int(table.lengths[row])
        if (
            len(shown) == (budgets.max_segments if budgets.max_segments is not None else COUNT)
            or faces > (budgets.max_triangles or 1 << 60)
            or payload_bytes > (budgets.max_bytes or 1 << 60)
        ):
            break
        shown.append((row % COUNT, row >= COUNT))
    return shown


class Link:
    """A session, a client, and messages under way between them."""

    def __init__(
        self,
        scene: SceneView,
        client: LandingClient,
        *,
        credit_bytes: int = 1 << 20,
        budgets: Budgets | None = None,
        groups: Any = None,
        **limits: Any,
    ) -> None:
        self.scene = scene
        self.client = client
        limits = {"max_messages_per_s": 1e6} | limits
        self.session = Session(
            scene, SessionLimits(**limits), session_id="s", now_s=0.0, groups=groups
        )
        self.down: deque[Message | Frame] = deque()
        self.broken: set[int] = set()
        """Rows whose payload cannot be read."""
        self.close: Close | None = None
        client.connected()
        self.tell(make_hello(credit_bytes=credit_bytes, budgets=budgets or Budgets()))
        self.serve()
        welcome = self.down.popleft()
        assert isinstance(welcome, Welcome)
        self.welcome = welcome

    def tell(self, message: Message) -> None:
        """Send a message to the service, through bytes."""
        received = decode(encode(message), Direction.CLIENT_TO_SERVER)
        self.session.receive(received, 0.0)

    def serve(self, most: int = 1 << 30) -> None:
        """Carry out actions of the session."""
        for _ in range(most):
            action = self.session.next_action()
            if isinstance(action, SendMessage):
                message = decode(encode(action.message), Direction.SERVER_TO_CLIENT)
                assert isinstance(message, Message)
                self.down.append(message)
            elif isinstance(action, MakePlan):
                self.session.make_plan(0.0)
            elif isinstance(action, SendChunk):
                self._send(action)
            elif isinstance(action, Close):
                self.close = action
            else:
                return

    def _send(self, chunk: SendChunk) -> None:
        if chunk.segment in self.broken:
            self.session.payload_failed(0.0)
            return
        table = self.scene.table
        data = payload_of(table, chunk.segment)[chunk.offset : chunk.offset + chunk.length]
        key = int(table.hashes[chunk.segment])
        frame = Frame(chunk.generation, key, chunk.offset, chunk.total, memoryview(data))
        self.down.append(frame)
        self.session.chunks_sent([chunk], 0.0)

    def deliver(self, most: int = 1 << 30) -> None:
        """Let what is under way arrive at the client."""
        for _ in range(min(most, len(self.down))):
            item = self.down.popleft()
            if isinstance(item, Frame):
                self.client.take_frame(item)
            else:
                assert not isinstance(item, Error), item
                self.client.take_message(item)


def actions_of(session: Session) -> list[Any]:
    """Return what the session wants to send and do, up to a plan or payload."""
    actions: list[Any] = []
    while isinstance(action := session.next_action(), SendMessage | RunPick | Close):
        actions.append(action.message if isinstance(action, SendMessage) else action)
    return actions


def check_shown(link: Link, cover: Cover, wanted: dict[str, Any], broken: set[int]) -> None:
    """Compare what the client shows with brute force."""
    rows = expected(link.scene, **wanted)
    rows = [(segment, coarser) for segment, coarser in rows
            if segment + COUNT * coarser not in broken]  # fmt: skip
    assert link.client.shown == set(rows)
    segments = {segment for segment, _ in rows}
    hidden = np.unpackbits(np.frombuffer(link.client.hidden, np.uint8), count=64, bitorder="little")
    for face in range(64):
        over = set(cover.over(face).tolist())
        assert hidden[face] == (bool(over) and over <= segments), face


@pytest.mark.parametrize("seed", range(300))
def test_what_is_shown_is_a_function_of_the_last_landing(seed: int) -> None:
    rng = random.Random(seed)
    levels = rng.choice([1, 2])
    scene, cover = make_scene(seed, levels)
    table = scene.table
    client = LandingClient()
    broken = set(rng.sample(range(COUNT * levels), rng.choice([0, 0, 3])))
    budgets = rng.choice([Budgets(), Budgets(max_segments=7), Budgets(max_bytes=2_000),
                          Budgets(max_triangles=100)])  # fmt: skip
    wanted: dict[str, Any] = {}
    fields: dict[str, Any] = {}
    keeps_all = rng.random() < 0.5

    def connect() -> Link:
        credit_bytes = rng.choice([0, 300, 5_000, 1 << 20])
        link = Link(scene, client, credit_bytes=credit_bytes, budgets=budgets)
        link.broken = broken
        return link

    link = connect()
    for _ in range(60):
        step = rng.random()
        if step < 0.2:
            radius_m = rng.uniform(1, 60)
            wanted = {"position": tuple(rng.uniform(0, 100) for _ in range(3)),
                      "radius_m": radius_m}  # fmt: skip
            if rng.random() < 0.4:
                wanted["coarse_radius_m"] = radius_m + rng.uniform(0, 40)
            if rng.random() < 0.3:
                wanted["inner_radius_m"] = radius_m / 2
            fields = dict(wanted)
            if rng.random() < 0.2:
                without = set(rng.sample(table.hashes.tolist(), 5))
                wanted["without"] = without
                fields["without"] = np.array(sorted(without), "<u8")
            link.tell(client.land(**fields))
            wanted["budgets"] = budgets
        elif step < 0.3:
            position = tuple(rng.uniform(0, 100) for _ in range(3))
            link.tell(client.prefetch(position, rng.uniform(1, 60)))
        elif step < 0.5:
            link.tell(Credit(bytes=rng.choice([10, 500, 5_000])))
        elif step < 0.7:
            link.serve(rng.randrange(1, 12))
        elif step < 0.9:
            link.deliver(rng.randrange(1, 12))
        elif step < 0.94 and client.have and not keeps_all:
            for key in rng.sample(list(client.have), rng.randint(1, len(client.have))):
                del client.have[key]
            if client.is_landing:  # else it would wait for what it said it has
                link.tell(client.land(**fields))
        elif step < 0.96:
            link.deliver(rng.randrange(1, 12))
            link = connect()  # what was under way is lost
            if wanted:
                link.tell(client.land(**fields))
    link.tell(Credit(bytes=1 << 20))
    link.serve()
    link.deliver()
    if wanted:
        assert not client.is_landing
        check_shown(link, cover, wanted, broken)
    if keeps_all:
        assert len(client.arrived) == len(set(client.arrived)), "a payload came twice"


def test_nothing_that_is_on_its_way_is_sent_again() -> None:
    scene, _ = make_scene(1)
    client = LandingClient()
    link = Link(scene, client)
    link.tell(client.land((50, 50, 50), 40))
    link.serve()
    first = [item for item in link.down if isinstance(item, Frame)]
    assert first
    link.tell(client.land((50, 50, 50), 60))  # before anything arrived
    link.serve()
    keys = [item.key for item in link.down if isinstance(item, Frame)]
    assert len(keys) == len(set(keys)) > len(first)
    link.deliver()
    assert client.shown_generation == 2


def test_a_segment_that_was_begun_is_finished_first() -> None:
    scene, _ = make_scene(1)
    table = scene.table
    client = LandingClient()
    link = Link(scene, client, credit_bytes=0)
    centre = table.bounds[3, :3].tolist()
    link.tell(client.land(centre, 30))
    link.serve()
    plan = link.down[0]
    assert isinstance(plan, Plan)
    begun = plan.show[1]
    link.tell(Credit(bytes=int(plan.show[0]["bytes"]) + int(begun["bytes"]) - 1))
    link.serve()
    link.tell(client.land(centre, 60))
    link.tell(Credit(bytes=1 << 20))
    link.serve()
    frames = [item for item in link.down if isinstance(item, Frame)]
    goes_on = next(frame for frame in frames if frame.generation == 2)
    assert (goes_on.key, goes_on.offset) == (begun["key"], begun["bytes"] - 1)
    link.deliver()
    assert client.shown_generation == 2


def test_a_segment_that_was_begun_and_is_not_wanted_begins_anew_later() -> None:
    scene, _ = make_scene(1)
    client = LandingClient()
    link = Link(scene, client, credit_bytes=1)
    link.tell(client.land((50, 50, 50), 40))
    link.serve()
    link.tell(client.land((-500, 0, 0), 1))
    link.serve()
    link.tell(Credit(bytes=1 << 20))
    link.tell(client.land((50, 50, 50), 40))
    link.serve()
    link.deliver()
    assert client.shown_generation == 3


def test_rows_say_what_follows_and_an_unreadable_payload_is_missing() -> None:
    scene, cover = make_scene(2)
    client = LandingClient()
    link = Link(scene, client)
    wanted = {"position": (50.0, 50.0, 50.0), "radius_m": 40.0}
    link.tell(client.land(**wanted))
    link.serve()
    link.deliver()
    kept = dict(list(client.have.items())[:3])
    client.have = dict(kept)
    table = scene.table
    link.broken = {segment for segment, _ in client.shown if int(table.hashes[segment]) not in kept}
    link.tell(client.land(**wanted))
    link.serve()
    plan, ready = link.down
    assert isinstance(plan, Plan)
    assert isinstance(ready, Ready)
    follows = {row[0] for row in plan.show.tolist() if row[5] & FOLLOWS}
    assert follows == {row[0] for row in plan.show.tolist()} - set(kept)
    assert ready.missing is not None
    assert set(ready.missing.tolist()) == follows
    link.deliver()
    check_shown(link, cover, wanted, link.broken)


def test_a_prefetch_waits_for_the_landing_and_has_no_answer() -> None:
    scene, _ = make_scene(3)
    client = LandingClient()
    link = Link(scene, client, credit_bytes=0)
    link.tell(client.land((50, 50, 50), 10))
    link.tell(client.prefetch((0, 0, 0), 60))
    link.tell(Credit(bytes=1 << 20))
    link.serve()
    generations = [item.generation for item in link.down if isinstance(item, Frame | Ready | Plan)]
    assert generations == sorted(generations)
    assert generations[-1] == 2
    assert isinstance(link.down[generations.index(2) - 1], Ready)
    link.deliver()
    link.tell(client.land((0, 0, 0), 60))
    link.serve()
    assert not [item for item in link.down if isinstance(item, Frame)]


@pytest.mark.parametrize("kind", ["land", "prefetch"])
def test_a_refused_landing_changes_nothing(kind: str) -> None:
    scene, _ = make_scene(3)
    client = LandingClient()
    link = Link(scene, client, credit_bytes=0)
    link.tell(client.land((50, 50, 50), 40))
    link.serve()
    wide = client.prefetch((0, 0, 0), 501) if kind == "prefetch" else client.land((0, 0, 0), 501)
    link.tell(wide)
    client.refused(before=1)
    link.tell(Credit(bytes=1 << 20))
    link.serve()
    error = next(item for item in link.down if isinstance(item, Error))
    assert (error.code, error.fatal, error.generation) == ("radius_too_large", False, 2)
    link.down.remove(error)
    link.deliver()
    assert client.shown_generation == 1


def test_an_older_generation_is_fatal() -> None:
    scene, _ = make_scene(3)
    client = LandingClient()
    link = Link(scene, client)
    link.tell(client.land((50, 50, 50), 40))
    again = Prefetch(generation=1, position=(0, 0, 0), radius_m=1, have=(), taken_bytes=0)  # type: ignore[arg-type]
    link.tell(again)
    link.serve()
    assert link.close is not None
    assert link.close.code == 4400


def test_draining_ends_the_open_landing_first() -> None:
    scene, _ = make_scene(3)
    client = LandingClient()
    link = Link(scene, client, credit_bytes=0)
    link.tell(client.land((50, 50, 50), 40))
    link.tell(client.prefetch((0, 0, 0), 40))
    link.session.drain(0.0, 10.0)
    link.serve()
    link.tell(client.prefetch((20, 0, 20), 40))  # the user points meanwhile
    link.serve()
    assert link.close is None
    link.tell(Credit(bytes=1 << 20))
    link.serve()
    assert link.close is not None
    assert link.close.code == 4503
    link.deliver()
    assert client.shown_generation == 1


def test_bye_closes() -> None:
    scene, _ = make_scene(3)
    link = Link(scene, LandingClient())
    link.tell(Bye())
    link.serve()
    assert link.close is not None
    assert link.close.code == 1000


# Before and after the landings.


def test_an_unknown_type_is_no_hello() -> None:
    """Else a stranger could send as many as it likes before it says who it is."""
    session = Session(make_scene(3)[0], SessionLimits(), session_id="s", now_s=0.0)
    session.receive(Unknown("wave"), 0.0)
    error, close = actions_of(session)
    assert (error.code, error.message) == (
        "out_of_order",
        "got an unknown type first, expected hello",
    )
    assert close == Close(CloseCode.MALFORMED, "out_of_order")


def test_a_bad_message_before_hello_is_fatal_whatever_it_is() -> None:
    session = Session(make_scene(3)[0], SessionLimits(), session_id="s", now_s=0.0)
    session.refuse(FieldError("land", "radius_m", "got -1", generation=1), 0.0)
    error, close = actions_of(session)
    assert (error.code, error.fatal, close.code) == ("invalid_field", True, CloseCode.MALFORMED)


def test_a_bad_landing_uses_up_its_generation() -> None:
    link = Link(make_scene(3)[0], LandingClient())
    link.session.refuse(FieldError("land", "radius_m", "got -1", generation=3), 0.0)
    link.serve()
    error = link.down.pop()
    assert isinstance(error, Error)
    assert (error.code, error.generation, error.fatal) == ("invalid_field", 3, False)
    link.tell(make_land(3, CENTRE, 40.0))
    link.serve()
    assert link.close == Close(CloseCode.MALFORMED, "out_of_order")


def test_nothing_follows_bye() -> None:
    link = Link(make_scene(3)[0], LandingClient())
    link.tell(Pick(request=4, origin=CENTRE))
    link.serve()
    link.tell(link.client.land(CENTRE, 40.0))
    link.session.scene_published("v2")
    link.tell(Bye())
    link.session.picked(4, None)
    assert actions_of(link.session) == [Close(CloseCode.NORMAL, "bye")]


def test_draining_takes_no_landing() -> None:
    link = Link(make_scene(3)[0], LandingClient(), credit_bytes=0)
    link.tell(link.client.land(CENTRE, 40.0))
    link.session.drain(0.0, 2.0)
    link.tell(link.client.land(CENTRE, 10.0))
    assert actions_of(link.session)[-1] == Close(CloseCode.DRAINING, "draining")


def test_draining_an_idle_session_ends_it() -> None:
    link = Link(make_scene(3)[0], LandingClient())
    link.session.drain(0.0, 2.0)
    assert [type(each) for each in actions_of(link.session)] == [Notice, Close]
    stranger = Session(make_scene(3)[0], SessionLimits(), session_id="s", now_s=0.0)
    stranger.drain(0.0, 2.0)
    assert [type(each) for each in actions_of(stranger)] == [Close]


def test_news_before_hello_wait_for_the_welcome() -> None:
    session = Session(make_scene(3)[0], SessionLimits(), session_id="s", now_s=0.0)
    session.scene_published("v2")
    assert actions_of(session) == []
    session.receive(make_hello(), 0.0)
    welcome, notice = actions_of(session)
    assert isinstance(welcome, Welcome)
    assert notice == Notice(kind="scene_published", version="v2")


def test_a_withdrawn_token_ends_the_session_as_unauthorised() -> None:
    link = Link(make_scene(3)[0], LandingClient())
    link.tell(link.client.land(CENTRE, 40.0))
    link.session.withdraw("the token has expired")
    link.session.withdraw("twice")
    error, close = actions_of(link.session)
    assert (error.code, error.fatal, close.code) == ("unauthorised", True, 4401)


def test_too_many_picks_at_once_are_refused_one_by_one() -> None:
    link = Link(make_scene(3)[0], LandingClient(), max_picks=1)
    for request in (4, 5):
        link.tell(Pick(request=request, origin=CENTRE))
    pick, error = actions_of(link.session)
    assert isinstance(pick, RunPick)
    assert (error.code, error.request, error.fatal) == ("too_many", 5, False)
    link.session.picked(4, None)
    link.tell(Pick(request=6, origin=CENTRE))
    picked, pick = actions_of(link.session)
    assert (picked.request, pick.request) == (4, 6)


def test_credit_is_clamped() -> None:
    link = Link(make_scene(3)[0], LandingClient(), max_credit_bytes=100)
    for _ in range(2):
        link.tell(link.client.land(CENTRE, 500.0))
        link.tell(Credit(bytes=1 << 50))
        link.serve()
        sent = sum(len(item.data) for item in link.down if isinstance(item, Frame))
        assert sent == 100
        link.deliver()


def test_what_a_newer_landing_ends_before_its_turn_is_never_planned() -> None:
    link = Link(make_scene(3)[0], LandingClient())
    for _ in range(100):
        link.tell(link.client.land(CENTRE, 40.0))
    assert link.session.next_action() == MakePlan()
    assert link.session.next_chunks(1) == []
    link.serve()
    assert [item.generation for item in link.down if isinstance(item, Plan)] == [100]


def test_a_plan_is_bounded_and_costs_what_is_near() -> None:
    scene, _ = make_scene(3)
    link = Link(scene, LandingClient(), max_plan_segments=2)
    link.tell(link.client.land(CENTRE, 40.0))
    assert link.session.make_plan(0.0) == len(scene.within(CENTRE, 40.0))
    link.serve()
    plan = next(item for item in link.down if isinstance(item, Plan))
    assert (len(plan.show), plan.omitted_by) == (2, "max_segments")


def test_the_observer_is_told_of_times_and_bytes() -> None:
    heard: list[Any] = []

    class Ear(Observer):
        def planned(self, generation: int, **counts: int) -> None:
            heard.append(("planned", generation, counts["payload_bytes"]))

        def first_byte(self, seconds: float) -> None:
            heard.append(("first byte", seconds))

        def ready(self, generation: int, *, seconds: float, **counts: int) -> None:
            heard.append(("ready", generation, seconds))

        def superseded(self, generation: int, unsent_bytes: int, *, landing: bool) -> None:
            heard.append(("superseded", unsent_bytes, landing))

        def rejected(self, generation: int, rows: Any) -> None:
            heard.extend(("rejected", row) for row in rows)

    scene, _ = make_scene(3)
    table = scene.table
    near = scene.within(CENTRE, 40.0)
    total = int(table.lengths[near].sum())
    session = Session(scene, SessionLimits(), session_id="s", now_s=0.0, observer=Ear())
    session.receive(make_hello(credit_bytes=10), 0.0)
    actions_of(session)
    session.receive(make_land(1, CENTRE, 40.0), 0.0)
    session.make_plan(0.25)
    actions_of(session)
    session.chunks_sent(session.next_chunks(1000), 0.25)
    session.receive(make_land(2, CENTRE, 1.0), 1.0)
    session.receive(make_land(3, (-500.0, 0.0, 0.0), 1.0), 1.0)
    session.make_plan(1.5)
    unusable = table.hashes[near[:1]]
    session.receive(make_land(4, CENTRE, 40.0, without=unusable, have=table.hashes.tolist()), 2.0)
    session.make_plan(2.0)
    assert heard == [
        ("planned", 1, total),
        ("first byte", 0.25),
        ("superseded", total - 10, True),
        ("superseded", 0, True),
        ("planned", 3, 0),
        ("ready", 3, 0.5),
        ("rejected", int(near[0])),
        ("planned", 4, 0),
        ("ready", 4, 0.0),
    ]


# Groups: what they do is in test_groups.py.


class GroupCalls:
    """A group port that records what the session asks of it."""

    def __init__(self) -> None:
        self.calls: list[Any] = []

    def join(self, join: Join, place: Any, now_s: float) -> str | None:
        self.calls.append(("join", place))
        return "full" if join.group == "full" else None

    def leave(self, now_s: float) -> None:
        self.calls.append("leave")

    def gather(self, gather: Gather, now_s: float) -> str | None:
        self.calls.append("gather")
        return None

    def arrived(self, arrived: Arrived) -> None:
        self.calls.append(arrived)

    def landed(self, place: Any, now_s: float) -> None:
        self.calls.append(("landed", place))


def grouped() -> tuple[Link, list[Any]]:
    port = GroupCalls()
    return Link(make_scene(3)[0], LandingClient(), groups=port), port.calls


def gathering(number: int) -> Gathering:
    return Gathering(gathering=number, guide=1, position=(0.0, 0.0, 0.0), radius_m=9.0)


def roster(group: str) -> Roster:
    return Roster(group=group, members=())


def test_a_join_says_where_the_newest_accepted_landing_is() -> None:
    link, calls = grouped()
    client = link.client
    link.tell(client.land((5.0, 0.0, 0.0), 25.0))
    link.tell(client.land((7.0, 0.0, 0.0), 1e6))  # refused: too large
    link.tell(client.prefetch((9.0, 0.0, 0.0), 25.0))
    link.tell(Join(request=1, group="full", role="member"))
    link.tell(Bye())
    assert calls == [("landed", (5.0, 0.0, 0.0)), ("join", (5.0, 0.0, 0.0)), "leave"]


def test_refusals_of_groups_leave_the_session_open() -> None:
    link, calls = grouped()
    link.tell(Join(request=1, group="full", role="member"))
    link.tell(Gather(request=2, position=(0.0, 0.0, 0.0), radius_m=500.5))
    link.tell(link.client.land(CENTRE, 40.0))
    link.session.drain(0.0, 10.0)
    link.tell(Join(request=3, group="tour", role="member"))
    link.serve()
    errors = [item for item in link.down if isinstance(item, Error)]
    assert [(error.request, error.fatal) for error in errors] == [
        (1, False),
        (2, False),
        (3, False),
    ]
    assert "at most 500" in errors[1].message
    assert "goes away" in errors[2].message
    assert calls == [("join", None), ("landed", CENTRE)]


def test_of_group_messages_that_wait_the_newest_of_each_type_is_sent_before_payload() -> None:
    link, _ = grouped()
    link.tell(link.client.land(CENTRE, 40.0))
    link.serve(3)
    for number in range(1, 500):
        link.session.tell_group(gathering(number))
        link.session.tell_group(roster(f"g{number}"))
    assert link.session.pending == 0
    link.down.clear()
    link.serve(3)
    first, second, frame = link.down
    assert [first, second] == [gathering(499), roster("g499")]
    assert isinstance(frame, Frame)


@pytest.mark.parametrize("way", ["leave", "join another"])
def test_news_of_a_group_that_was_left_are_dropped(way: str) -> None:
    link, _ = grouped()
    link.session.tell_group(roster("old"))
    joined = Joined(request=1, group="new", member=1, role="member", seat="s")
    if way == "leave":
        link.tell(Leave())
    else:
        link.session.tell_group(joined)
    link.session.tell_group(gathering(1))
    assert actions_of(link.session) == ([] if way == "leave" else [joined]) + [gathering(1)]
