"""Waits before reconnecting, and whether at all."""

from __future__ import annotations

import random

import pytest

from terraport.backoff import is_temporary, wait_s


@pytest.mark.parametrize("attempt", [0, 1, 3, 5, 6, 60, 10**6])
def test_waits_stay_between_half_and_all_of_the_doubling(attempt: int) -> None:
    """0.5 s, doubled each time, never above 30 s."""
    most = min(30.0, 0.5 * 2.0 ** min(attempt, 30))
    chance = random.Random(1)
    waits = [wait_s(attempt, chance.random) for _ in range(200)]
    assert all(most / 2 <= wait <= most for wait in waits)
    assert max(waits) - min(waits) > 0.3 * most  # they do spread


@pytest.mark.parametrize(
    ("code", "again"),
    [
        *((code, True) for code in (1001, 1006, 1011, 1012, 4408, 4429, 4500, 4503)),
        *((code, False) for code in (1000, 4400, 4401, 4403, 4404, 4409, 4413)),
    ],
)
def test_close_codes_as_the_protocol_lists_them(code: int, again: bool) -> None:
    assert is_temporary(code) is again
