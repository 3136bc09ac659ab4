"""Fixtures of the SDK's tests."""

from __future__ import annotations

import pytest
from sdk.pairing import Pair, ToyScene


@pytest.fixture
def toy() -> ToyScene:
    """A scene of 36 small segments."""
    return ToyScene()


@pytest.fixture
def pair(toy: ToyScene) -> Pair:
    """A client that is about to be welcomed."""
    pair = Pair(toy)
    pair.connect()
    return pair
