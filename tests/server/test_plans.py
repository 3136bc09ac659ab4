"""What a client is told of a selection: made without checks, equal to what checks would make."""

from __future__ import annotations

import dataclasses

from hypothesis import given, settings
from hypothesis import strategies as st
from server.plain_client import make_hello
from server.session_model import aim, land, make_scene

from terraport_server.session.id_set import IdSet
from terraport_server.session.interface import SessionLimits
from terraport_server.session.planner import Planner
from terraport_wire import Budgets, Direction, Plan, Prefetch, decode, encode


@settings(max_examples=100)
@given(
    x=st.floats(-20, 130),
    radius_m=st.floats(0.5, 80),
    held_ids=st.sets(st.integers(0, 11)),
    most=st.none() | st.integers(0, 9),
)
def test_every_plan_passes_the_checks_that_it_was_made_without(
    x: float, radius_m: float, held_ids: set[int], most: int | None
) -> None:
    scene = make_scene()
    planner = Planner(scene, SessionLimits(), make_hello(budgets=Budgets(max_segments=most)))
    held, wish = IdSet(sorted(held_ids)), land(3, x, radius_m, inner_radius_m=min(5.0, radius_m))
    plan = planner.plan(wish, planner.choose(wish, held)[0])
    wish_ahead = aim(4, x, radius_m)
    ahead = planner.prefetch(wish_ahead, planner.choose(wish_ahead, held)[0])
    for message, kind in ((plan, Plan), (ahead, Prefetch)):
        names = [field.name for field in dataclasses.fields(kind)]
        checked = kind(**{name: getattr(message, name) for name in names})
        assert checked == message
        for name in names:
            assert type(getattr(checked, name)) is type(getattr(message, name)), name
        data = encode(message)
        assert data == encode(checked)
        assert decode(data, Direction.SERVER_TO_CLIENT) == message
