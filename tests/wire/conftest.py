"""Strategies for random messages, made from the same field kinds as the codec."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

import terraport_wire as m
from terraport_wire import kinds, tables
from terraport_wire.message import PartKind, PartList, fields_of

_U32 = st.integers(0, 2**32 - 1)
_U64 = st.integers(0, 2**64 - 1)
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


@st.composite
def _load_rows(draw: Callable[..., Any]) -> Any:
    ids = draw(st.lists(_U32, max_size=6, unique=True))
    rows = np.zeros(len(ids), dtype=tables.LOAD_DTYPE)
    for row, segment in zip(rows, ids, strict=True):
        low = draw(st.tuples(*[st.floats(-9e6, 9e6, width=32)] * 3))
        size = draw(st.tuples(*[st.floats(0, 1e5, width=32)] * 3))
        row["id"], row["xxh3"] = segment, draw(_U64)
        row["length"] = draw(st.integers(1, 2**26))
        row["faces"], row["vertices"] = draw(_U32), draw(_U32)
        row["bounds"][:3] = low
        row["bounds"][3:] = np.float32(low) + np.float32(size)
    return rows


_BY_KIND: dict[type, Callable[[Any], st.SearchStrategy[Any]]] = {
    kinds.Integer: lambda kind: st.integers(kind.low, kind.high),
    kinds.Number: _number,
    kinds.Flag: lambda _: st.booleans(),
    kinds.Text: _text,
    kinds.Choice: lambda kind: st.sampled_from(kind.options),
    kinds.Position: _position,
    kinds.Version: lambda _: st.tuples(st.integers(0, 65_535), st.integers(0, 65_535)),
    kinds.VersionList: lambda _: st.lists(st.tuples(st.just(1), st.integers(0, 9)), max_size=3),
    kinds.NumberMap: lambda kind: st.dictionaries(
        st.text(_TEXT, min_size=1, max_size=9),
        st.floats(allow_nan=False, allow_infinity=False),
        max_size=4,
    ),
    tables.Ids: lambda _: st.lists(_U32, max_size=8, unique=True),
    tables.HeldTable: lambda _: st.lists(
        st.tuples(_U32, _U64), max_size=5, unique_by=lambda row: row[0]
    ),
    tables.LoadTable: lambda _: _load_rows(),
    PartKind: lambda kind: part_strategy(kind.part),
    PartList: lambda kind: st.lists(part_strategy(kind.part), max_size=3).map(tuple),
}


def part_strategy(part_type: type[m.Part]) -> st.SearchStrategy[Any]:
    """Strategy for a message or part class, every field free but for the sums."""
    required, optional = {}, {}
    for field in fields_of(part_type):
        strategy = _BY_KIND[type(field.kind)](field.kind)
        (required if field.required else optional)[field.name] = strategy
    values = st.fixed_dictionaries(required, optional=optional)
    return values.map(_consistent(part_type)).map(lambda fields: part_type(**fields))


def _consistent(part_type: type[m.Part]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Make the fields that must agree agree."""

    def plan(fields: dict[str, Any]) -> dict[str, Any]:
        load, seen = fields["load"], set(fields["load"]["id"].tolist())
        fields["keep"] = [segment for segment in fields["keep"] if segment not in seen]
        seen.update(fields["keep"])
        fields["nearby"] = [segment for segment in fields["nearby"] if segment not in seen]
        fields["load_bytes"] = int(load["length"].sum(dtype="u8"))
        fields["load_triangles"] = int(load["faces"].sum(dtype="u8"))
        fields["total_bytes"] = max(fields["total_bytes"], fields["load_bytes"])
        fields["total_triangles"] = max(fields["total_triangles"], fields["load_triangles"])
        if "omitted_by" not in fields:
            fields["omitted_segments"] = 0
        elif fields["omitted_segments"] == 0:
            fields["omitted_segments"] = 1
        return fields

    def prefetch(fields: dict[str, Any]) -> dict[str, Any]:
        return {**fields, "bytes": int(fields["segments"]["length"].sum(dtype="u8"))}

    def aim(fields: dict[str, Any]) -> dict[str, Any]:
        if "coarse_radius_m" in fields:
            fields["coarse_radius_m"] = max(fields["coarse_radius_m"], fields["radius_m"])
        return fields

    def land(fields: dict[str, Any]) -> dict[str, Any]:
        aim(fields)
        if "inner_radius_m" in fields:
            fields["inner_radius_m"] = min(fields["inner_radius_m"], fields["radius_m"])
        else:
            fields.pop("deadline_ms", None)
            fields.pop("stall_ms", None)
        return fields

    def gather(fields: dict[str, Any]) -> dict[str, Any]:
        if "inner_radius_m" in fields:
            fields["inner_radius_m"] = min(fields["inner_radius_m"], fields["radius_m"])
        return fields

    return {m.Plan: plan, m.Prefetch: prefetch, m.Aim: aim, m.Land: land, m.Gather: gather}.get(
        part_type, lambda fields: fields
    )


@pytest.fixture(scope="session")
def any_message() -> st.SearchStrategy[m.Message]:
    """Strategy for any message of either direction."""
    types = [message for by_type in m.MESSAGES.values() for message in by_type.values()]
    return st.one_of([part_strategy(message) for message in types])
