"""What a caller says is checked before anything is sent."""

from __future__ import annotations

import math

import pytest

import terraport
from terraport.errors import UsageError
from terraport.options import SessionOptions, Timeouts, point


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"credit_bytes": 0}, "credit_bytes is 0, expected 1 or more"),
        ({"max_bytes": -1}, "max_bytes"),
    ],
)
def test_options_that_cannot_be_are_refused(options, text: str) -> None:
    with pytest.raises(UsageError, match=text):
        SessionOptions(client="test", **options)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"url": "pit"}, "expected http"),
    ],
)
def test_connect_refuses_before_it_does_anything(options, text: str) -> None:
    with pytest.raises(UsageError, match=text):
        terraport.connect(**{"url": "http://h/scenes/pit", **options})


@pytest.mark.parametrize(
    "position", ["here", None, (1.0, 2.0), (1.0, "two", 3.0), [[1, 2], 3, 4], 5.0, {"x": 1.0}]
)
def test_what_is_no_position_is_the_callers_error(position) -> None:
    with pytest.raises(UsageError, match="expected three numbers x, y, z"):
        point(position)


def test_timeouts_are_none_or_above_zero() -> None:
    assert Timeouts(connect_s=None, plan_s=0.1).plan_s == 0.1
    for value in (0, -1.0, math.nan):
        with pytest.raises(UsageError, match=r"http_s is .*, expected above 0"):
            Timeouts(http_s=value)
