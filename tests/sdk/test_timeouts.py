"""Timeouts are checked on construction."""

from __future__ import annotations

import math

import pytest

from terraport.errors import UsageError
from terraport.timeouts import Timeouts


def test_none_and_numbers_above_zero_are_fine() -> None:
    assert Timeouts(connect_s=None, plan_s=0.1).plan_s == 0.1


@pytest.mark.parametrize("value", [0, -1.0, math.nan])
def test_everything_else_is_refused(value: float) -> None:
    with pytest.raises(UsageError, match=r"http_s is .*, expected above 0"):
        Timeouts(http_s=value)
