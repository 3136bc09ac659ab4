"""Who gives way where there is no room."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from terraport_server.strangers import Strangers


def test_the_oldest_of_the_address_with_most() -> None:
    strangers = Strangers[str]()
    assert strangers.in_the_way() is None
    assert strangers.heaviest() is None
    for peer in ("a1", "b1", "b2", "c1", "b3"):
        strangers.enter(peer, peer[0])
    assert strangers.in_the_way() == "b1"
    strangers.leave("b1")
    strangers.leave("b1")
    assert strangers.in_the_way() == "b2"
    strangers.weigh("b2", 10)
    strangers.weigh("c1", 8)
    strangers.weigh("b3", 1)
    assert strangers.weigh("b1", 1000) == 0  # gone
    assert strangers.weigh("b3", 2) == 13
    assert strangers.weigh("b3", -1) == 12
    assert strangers.heaviest_beside("b3") == "b2"
    assert strangers.heaviest_beside("b1") is None
    assert strangers.heaviest() == "b2"
    strangers.leave("b2")
    assert strangers.heaviest() == "c1"


@given(st.lists(st.tuples(st.sampled_from("ewl"), st.integers(0, 9), st.integers(0, 100))))
def test_the_sums_hold(steps: list[tuple[str, int, int]]) -> None:
    strangers, model = Strangers[int](), dict[int, int]()
    for step, peer, count in steps:
        if step == "e" and peer not in model:
            strangers.enter(peer, str(peer % 3))
            model[peer] = 0
        elif step == "w":
            strangers.weigh(peer, count)
            if peer in model:
                model[peer] += count
        elif step == "l":
            strangers.leave(peer)
            model.pop(peer, None)
        assert len(strangers) == len(model)
        assert strangers.total_bytes == sum(model.values())
        assert (strangers.in_the_way() is None) == (not model)
