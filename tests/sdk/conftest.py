"""Fixtures of the SDK's tests."""

from __future__ import annotations

import pytest
from sdk.pairing import Pair, ToyScene


@pytest.fixture
def pair() -> Pair:
    """A client that is welcome."""
    pair = Pair(ToyScene())
    pair.connect()
    pair.settle()
    return pair
