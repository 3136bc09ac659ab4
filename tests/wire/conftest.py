"""Strategies for random messages, made from the same field kinds as the codec."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

import terraport_wire as m
from terraport_wire import kinds
from terraport_wire.message import Part, PartKind, PartList, fields_of

_TEXT = st.characters(exclude_categories=["Cs"])


def _number(kind: kinds.Number) -> st.SearchStrategy[float]:
    return st.floats(kind.low, kind.high, exclude_min=kind.low_excluded)


def _text(kind: kinds.Text) -> st.SearchStrategy[str]:
    if kind.pattern is not None:
        return st.from_regex(kind.pattern, fullmatch=True).filter(lambda s: len(s) <= kind.longest)
    return st.text(_TEXT, min_size=kind.shortest, max_size=min(kind.longest, 40))


def _position(kind: kinds.Position) -> st.SearchStrategy[Any]:
    axis = st.floats(-kind.bound, kind.bound)
    return st.tuples(axis, axis, axis).filter(lambda p: any(p) or not kind.nonzero)


def _rows(kind: kinds.Rows) -> st.SearchStrategy[Any]:
    return st.integers(0, 6).flatmap(
        lambda count: st.binary(
            min_size=count * kind.dtype.itemsize, max_size=count * kind.dtype.itemsize
        ).map(lambda data: np.frombuffer(data, kind.dtype))
    )


_BY_KIND: dict[type, Callable[[Any], st.SearchStrategy[Any]]] = {
    kinds.Integer: lambda kind: st.integers(kind.low, kind.high),
    kinds.Number: _number,
    kinds.Flag: lambda _: st.booleans(),
    kinds.Text: _text,
    kinds.Choice: lambda kind: st.sampled_from(kind.options),
    kinds.Position: _position,
    kinds.NumberMap: lambda kind: st.dictionaries(
        st.text(_TEXT, min_size=1, max_size=9),
        st.floats(allow_nan=False, allow_infinity=False),
        max_size=4,
    ),
    kinds.Rows: _rows,
    kinds.Binary: lambda _: st.binary(max_size=40),
    PartKind: lambda kind: part_strategy(kind.part),
    PartList: lambda kind: st.lists(part_strategy(kind.part), max_size=3).map(tuple),
}


def part_strategy(part_type: type[Part]) -> st.SearchStrategy[Any]:
    """Strategy for a message or part class, every field free but for the radii."""
    required, optional = {}, {}
    for field in fields_of(part_type):
        strategy = _BY_KIND[type(field.kind)](field.kind)
        (required if field.required else optional)[field.name] = strategy
    values = st.fixed_dictionaries(required, optional=optional)
    return values.map(_consistent(part_type)).map(lambda fields: part_type(**fields))


def _consistent(part_type: type[Part]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Make the fields that must agree agree."""

    def prefetch(fields: dict[str, Any]) -> dict[str, Any]:
        if "coarse_radius_m" in fields:
            fields["coarse_radius_m"] = max(fields["coarse_radius_m"], fields["radius_m"])
        return fields

    def land(fields: dict[str, Any]) -> dict[str, Any]:
        return gather(prefetch(fields))

    def gather(fields: dict[str, Any]) -> dict[str, Any]:
        if "inner_radius_m" in fields:
            fields["inner_radius_m"] = min(fields["inner_radius_m"], fields["radius_m"])
        return fields

    return {m.Prefetch: prefetch, m.Land: land, m.Gather: gather}.get(
        part_type, lambda fields: fields
    )


@pytest.fixture(scope="session")
def any_message() -> st.SearchStrategy[m.Message]:
    """Strategy for any message of either direction."""
    types = [message for by_type in m.MESSAGES.values() for message in by_type.values()]
    return st.one_of([part_strategy(message) for message in types])
