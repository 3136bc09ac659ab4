"""The registry of messages, and what construction checks."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from wire.samples import SAMPLES

import terraport_wire as m
from terraport_wire import InvalidMessageError


def test_every_message_class_is_registered_once_in_its_own_direction() -> None:
    classes = {
        getattr(m, name)
        for name in m.__all__
        if isinstance(getattr(m, name), type)
        and issubclass(getattr(m, name), m.Message)
        and getattr(m, name) is not m.Message
    }
    registered = [message for messages in m.MESSAGES.values() for message in messages.values()]
    assert len(registered) == len(set(registered))
    assert set(registered) == classes
    for direction, messages in m.MESSAGES.items():
        for name, message in messages.items():
            assert (name, direction) == (message.TYPE, message.DIRECTION)


def test_the_samples_hold_every_type() -> None:
    types = {name for messages in m.MESSAGES.values() for name in messages}
    assert {message.TYPE for message in SAMPLES} == types


@pytest.mark.parametrize("message", SAMPLES, ids=lambda message: message.TYPE)
def test_messages_are_frozen_and_slotted(message: m.Message) -> None:
    assert not hasattr(message, "__dict__")
    for field in dataclasses.fields(message):  # type: ignore[arg-type]
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(message, field.name, None)


@pytest.mark.parametrize("message", SAMPLES, ids=lambda message: message.TYPE)
def test_arrays_are_read_only(message: m.Message) -> None:
    for field in dataclasses.fields(message):  # type: ignore[arg-type]
        value = getattr(message, field.name)
        if isinstance(value, np.ndarray):
            assert not value.flags.writeable
            assert value.flags.c_contiguous


def place(**fields: object) -> dict[str, Any]:
    return {"generation": 1, "position": (0, 0, 0), "radius_m": 2, "have": [], "taken_bytes": 0,
            **fields}  # fmt: skip


def test_the_callers_array_is_not_changed_and_not_shared() -> None:
    keys = np.array([3, 1], dtype=np.uint64)
    message = m.Prefetch(**place(have=keys))
    keys[0] = 9
    assert message.have.tolist() == [3, 1]
    assert keys.flags.writeable


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda: m.Land(**place(position=(0, 0, float("nan")))),
            (
                "land.position: got [0, 0, nan], "
                "expected three finite numbers of size at most 10000000"
            ),
        ),
        (
            lambda: m.Land(**place(inner_radius_m=3)),
            "land.inner_radius_m: got 3, expected at most radius_m 2",
        ),
        (
            lambda: m.Land(**place(coarse_radius_m=1)),
            "land.coarse_radius_m: got 1, expected at least radius_m 2",
        ),
        (
            lambda: m.Credit(bytes=True),
            "credit.bytes: got True, expected an integer from 1 to 9007199254740991",
        ),
        (
            lambda: m.Budgets(max_bytes=-1),
            "budgets.max_bytes: got -1, expected an integer from 0 to 9007199254740991",
        ),
        (
            lambda: m.Land(**place(have=range(4097))),
            "land.have: got shape (4097,), expected at most 4096 rows",
        ),
    ],
)
def test_a_message_that_may_not_be_sent_is_our_own_error(make: object, text: str) -> None:
    with pytest.raises(InvalidMessageError) as caught:
        make()  # type: ignore[operator]
    assert str(caught.value) == text
    assert isinstance(caught.value, ValueError)


def test_equality_compares_arrays_as_wholes() -> None:
    land = m.Land(**place(have=[1, 2]))
    assert land == m.Land(**place(have=np.array([1, 2], dtype=np.int64)))
    assert land != m.Land(**place(have=[2, 1]))
    assert land != dataclasses.replace(land, without=np.zeros(1, m.KEY_DTYPE))
    assert m.Bye() != m.Unknown("bye")
    with pytest.raises(TypeError):
        hash(land)
