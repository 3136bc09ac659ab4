from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import pytest

from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import (
    BYTES,
    COUNT,
    OFFSET,
    Option,
    check_options,
    option_fields,
    parse_bytes,
    parse_count,
    parse_length,
    parse_offset,
)


def test_a_length_may_say_its_unit() -> None:
    assert parse_length("15m") == parse_length("15") == parse_length(" 15 M ") == 15.0
    assert parse_length("50ft") == pytest.approx(15.24)
    assert [parse_length(text) for text in ("250cm", "0.3km", ".5 m", "1e-2km")] == pytest.approx(
        [2.5, 300.0, 0.5, 10.0]
    )
    for text in ("", "m", "15 yards", "-3m", "nan", "1,5m"):
        with pytest.raises(OptionError, match=r"region size .*; expected metres, for example 15m"):
            parse_length(text, "region size")


@dataclass(frozen=True, slots=True)
class Ground:
    """A base."""

    kind: Annotated[Literal["rock", "sand"], Option()] = "rock"
    """Rock is hard;
    sand is not."""
    depth_m: Annotated[float | None, Option(above=0, most=100, unit="m", unset="all")] = None
    """How deep to dig, metres."""
    bare: int = 3
    """Not an option."""

    def __post_init__(self) -> None:
        check_options(self)


@dataclass(frozen=True, slots=True)
class Pit(Ground):
    """Derived, with more."""

    benches: Annotated[int, Option(least=1, below=9, flags=("--steps", "-s"))] = 4
    """Benches."""
    points: Annotated[int, Option(least=50, notation=COUNT)] = 200_000
    """Points."""
    is_wet: Annotated[bool, Option()] = False
    """Whether there is water."""


def test_fields_know_all_that_was_declared_once() -> None:
    fields = {field.name: field for field in option_fields(Pit)}
    assert list(fields) == ["kind", "depth_m", "benches", "points", "is_wet"]
    kind, depth, benches, points, is_wet = fields.values()
    assert (kind.type, kind.choices, kind.default, kind.metavar) == (
        str, ("rock", "sand"), "rock", "rock|sand",
    )  # fmt: skip
    assert kind.text == "Rock is hard; sand is not. [default: rock]"
    assert (depth.type, depth.flags, depth.default) == (float, ("--depth-m",), None)
    assert depth.text == "How deep to dig, metres. Above 0, at most 100 m. [default: all]"
    assert (benches.flags, benches.key, benches.metavar) == (("--steps", "-s"), "steps", None)
    assert benches.text == "Benches. 1 to below 9. [default: 4]"
    assert points.text == "Points. At least 50. [default: 200,000]"
    assert (points.metavar, points.read("1.5k"), points.read(None)) == ("COUNT", 1500, None)
    assert is_wet.text == "Whether there is water."


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "clay"}, "kind 'clay'; expected rock or sand"),
        ({"depth_m": 0.0}, "depth 0 m; expected above 0, at most 100 m"),
        ({"depth_m": float("nan")}, "depth nan m; expected above 0, at most 100 m"),
        ({"depth_m": 100.5}, "depth 100.5 m; expected above 0, at most 100 m"),
        ({"benches": 0}, "steps 0; expected 1 to below 9"),
        ({"benches": 9}, "steps 9; expected 1 to below 9"),
        ({"points": 49}, "points 49; expected at least 50"),
    ],
    ids=str,
)
def test_what_is_out_of_bounds_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError) as raised:
        Pit(**options)
    assert str(raised.value) == message


def test_bounds_may_be_reached_or_not() -> None:
    assert Pit(depth_m=100.0, benches=1, points=50, bare=-1).benches == 1
    assert Pit(depth_m=1e-9, benches=8).depth_m == 1e-9


@pytest.mark.parametrize(
    ("text", "count"),
    [("300000", 300_000), ("300_000", 300_000), ("300k", 300_000), ("1.5M", 1_500_000)],
)
def test_counts(text: str, count: int) -> None:
    assert parse_count(text) == count


@pytest.mark.parametrize("text", ["", "k", "-5", "1e6", "5 G"])
def test_bad_counts(text: str) -> None:
    with pytest.raises(OptionError, match=r"^base faces '.*'; expected a number such as"):
        parse_count(text, "base faces")


@pytest.mark.parametrize(
    ("text", "expected"),
    [("8G", 8 * 2**30), ("500m", 500 * 2**20), ("1.5 GiB", 3 * 2**29), ("10485760", 10 * 2**20)],
)
def test_sizes(text: str, expected: int) -> None:
    assert parse_bytes(text) == expected


@pytest.mark.parametrize("text", ["", "G", "-1G", "8X", "1e9", "nan", "8", "4096"])
def test_sizes_that_are_none(text: str) -> None:
    with pytest.raises(OptionError, match="expected a number"):
        parse_bytes(text)


def test_offsets() -> None:
    assert parse_offset("1,-2.5,3e2") == (1.0, -2.5, 300.0)
    for text in ("1,2", "a,b,c", "1,2,nan", ""):
        with pytest.raises(OptionError, match="three finite numbers"):
            parse_offset(text)


@pytest.mark.parametrize(
    ("notation", "value"),
    [(COUNT, 50), (COUNT, 200_000), (BYTES, 2**28), (BYTES, 3 * 2**29), (OFFSET, (1.5, -2.0, 0.0))],
)
def test_what_is_shown_can_be_given(notation: Any, value: Any) -> None:
    assert notation.parse(notation.show(value), "it") == value
