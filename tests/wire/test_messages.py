"""The registry of messages, and what construction checks."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conformance.wire_samples import FULL, MINIMAL

import terraport_wire as m
from terraport_wire import HELD_DTYPE, LOAD_DTYPE, InvalidMessageError


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
    assert {message.TYPE for message in MINIMAL} == types
    assert {message.TYPE for message in FULL} == types


@pytest.mark.parametrize("message", FULL, ids=lambda message: message.TYPE)
def test_messages_are_frozen_and_slotted(message: m.Message) -> None:
    assert not hasattr(message, "__dict__")
    for field in dataclasses.fields(message):  # type: ignore[arg-type]
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(message, field.name, None)


@pytest.mark.parametrize("message", FULL, ids=lambda message: message.TYPE)
def test_arrays_are_read_only(message: m.Message) -> None:
    for field in dataclasses.fields(message):  # type: ignore[arg-type]
        value = getattr(message, field.name)
        if isinstance(value, np.ndarray):
            assert not value.flags.writeable
            assert value.flags.c_contiguous


def test_the_callers_array_is_not_changed_and_not_shared() -> None:
    ids = np.array([3, 1], dtype=np.uint32)
    message = m.Evict(segments=ids)
    ids[0] = 9
    assert message.segments.tolist() == [3, 1]
    assert ids.flags.writeable


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda: m.Land(generation=1, position=(0, 0, float("nan")), radius_m=1),
            (
                "land.position: got [0, 0, nan], "
                "expected three finite numbers of size at most 10000000"
            ),
        ),
        (
            lambda: m.Land(generation=1, position=(0, 0, 0), radius_m=2, inner_radius_m=3),
            "land.inner_radius_m: got 3, expected at most radius_m 2",
        ),
        (
            lambda: m.Land(generation=1, position=(0, 0, 0), radius_m=2, deadline_ms=3),
            "land.deadline_ms: got a deadline without inner_radius_m, expected both",
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
            lambda: m.Evict(segments=[1, 2, 1]),
            "evict.segments: got id 1 twice, expected each id once",
        ),
        (
            lambda: m.Hello(
                protocol=(1, 0), client="", encoding="obj", budgets=m.Budgets(), credit_bytes=0
            ),
            "hello.encoding: got 'obj', expected one of segment-2",
        ),
        (
            lambda: m.Prefetch(generation=0, segments=[(1, 5, 0, 1, 1, (0,) * 6)], bytes=4),
            "prefetch.bytes: got 4, expected the sum of the segments' lengths",
        ),
    ],
)
def test_a_message_that_may_not_be_sent_is_our_own_error(make: object, text: str) -> None:
    with pytest.raises(InvalidMessageError) as caught:
        make()  # type: ignore[operator]
    assert str(caught.value) == text
    assert isinstance(caught.value, ValueError)


def test_equality_compares_arrays_as_wholes() -> None:
    assert m.Evict(segments=[1, 2]) == m.Evict(segments=np.array([1, 2], dtype=np.int64))
    assert m.Evict(segments=[1, 2]) != m.Evict(segments=[2, 1])
    assert m.Bye() != m.Unknown("bye")
    held_segments = np.array([(1, 2)], dtype=HELD_DTYPE)
    hello = m.Hello(
        protocol=(1, 0),
        client="",
        encoding="segment-2",
        budgets=m.Budgets(),
        credit_bytes=0,
        held=held_segments,
    )
    assert hello != dataclasses.replace(hello, held=None)
    with pytest.raises(TypeError):
        hash(hello)


def test_a_plan_sums_beyond_32_bits() -> None:
    rows = np.zeros(100, dtype=LOAD_DTYPE)
    rows["id"] = np.arange(100)
    rows["length"], rows["faces"] = 2**26, 2**32 - 1
    bytes_, faces = 100 * 2**26, 100 * (2**32 - 1)
    plan = dataclasses.replace(
        next(message for message in MINIMAL if isinstance(message, m.Plan)),
        load=rows,
        load_bytes=bytes_,
        total_bytes=bytes_,
        load_triangles=faces,
        total_triangles=faces,
    )
    assert plan.load_bytes == 6_710_886_400


@pytest.mark.parametrize(
    ("keep", "nearby", "field"),
    [([7], [], "load"), ([1], [1], "nearby"), ([], [7], "nearby")],
)
def test_an_id_stands_in_one_list_of_a_plan(keep: list[int], nearby: list[int], field: str) -> None:
    plan = next(message for message in FULL if isinstance(message, m.Plan))
    with pytest.raises(InvalidMessageError, match="to be disjoint") as caught:
        dataclasses.replace(plan, keep=keep, nearby=nearby)
    assert caught.value.field == field
