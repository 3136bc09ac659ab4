"""The client stays within the server's own limiter."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from terraport.pacing import Pacer
from terraport_server.session.rate_limit import RateLimit


@given(
    pauses=st.lists(st.floats(0, 3), min_size=1, max_size=300),
    per_s=st.floats(0.5, 200),
)
def test_the_server_never_finds_it_too_fast(pauses: list[float], per_s: float) -> None:
    """Sent when the pacer says so, every message is admitted by the server's bucket."""
    now_s = 100.0
    pacer, limit = Pacer(per_s, now_s=now_s), RateLimit(per_s, now_s=now_s)
    for pause_s in pauses:
        now_s += pause_s
        now_s += pacer.take(now_s)
        assert limit.take(now_s)
