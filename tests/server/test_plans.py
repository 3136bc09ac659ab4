"""What a client is told of a selection: made without checks, equal to what checks would make."""

from __future__ import annotations

import dataclasses

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from server.session_model import aim, land, make_scene

from terraport_server.plans import make_plan, make_prefetch
from terraport_server.selection import Budgets, select
from terraport_wire import Direction, Plan, Prefetch, decode, encode


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
    table = scene.encodings["glb"]
    wish = land(3, x, radius_m, inner_radius_m=min(5.0, radius_m))
    candidates = scene.within(wish.position, radius_m * 1.25)
    chosen = select(
        table,
        candidates,
        wish.position,
        radius_m,
        release_radius_m=radius_m * 1.25,
        inner_radius_m=wish.inner_radius_m,
        held=np.isin(candidates, sorted(held_ids)),
        budgets=Budgets(max_segments=most),
    )
    plan = make_plan(wish, chosen, table, release_radius_m=radius_m * 1.25)
    ahead = make_prefetch(aim(4, x, radius_m), chosen, table)
    for message, kind in ((plan, Plan), (ahead, Prefetch)):
        names = [field.name for field in dataclasses.fields(kind)]
        checked = kind(**{name: getattr(message, name) for name in names})
        assert checked == message
        for name in names:
            assert type(getattr(checked, name)) is type(getattr(message, name)), name
        data = encode(message)
        assert data == encode(checked)
        assert decode(data, Direction.SERVER_TO_CLIENT) == message
