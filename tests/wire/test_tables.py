"""Packed arrays: layout, bytes, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_wire import HELD_DTYPE, ID_DTYPE, LOAD_DTYPE
from terraport_wire.kinds import Refused
from terraport_wire.tables import HeldTable, Ids, LoadTable


def test_the_layouts_are_those_of_the_specification() -> None:
    assert ID_DTYPE.itemsize == 4
    assert HELD_DTYPE.itemsize == 12
    assert LOAD_DTYPE.itemsize == 48
    assert {name: field[1] for name, field in (HELD_DTYPE.fields or {}).items()} == {
        "id": 0,
        "xxh3": 4,
    }
    assert {name: field[1] for name, field in (LOAD_DTYPE.fields or {}).items()} == {
        "id": 0,
        "length": 4,
        "xxh3": 8,
        "faces": 16,
        "vertices": 20,
        "bounds": 24,
    }


def test_held_bytes() -> None:
    kind = HeldTable(10)
    rows = kind.check([(1, 0xFF), (2, 0x0123456789ABCDEF)])
    packed = b"\x01\0\0\0\xff\0\0\0\0\0\0\0" + b"\x02\0\0\0\xef\xcd\xab\x89\x67\x45\x23\x01"
    assert kind.to_wire(rows) == packed
    assert (kind.from_wire(packed) == rows).all()


@pytest.mark.parametrize(
    "value",
    [
        [3, 1],
        (3, 1),
        np.array([3, 1]),
        np.array([3, 1], "u8"),
        np.array([3, 1], ">u4"),
        [np.int64(3), 1],
    ],
)
def test_ids_take_any_integers(value: object) -> None:
    ids = Ids(5).check(value)
    assert ids.dtype == ID_DTYPE
    assert ids.tolist() == [3, 1]


@pytest.mark.parametrize("value", [[], (), range(0), np.zeros(0), np.zeros(0, "u4")])
def test_no_ids_at_all(value: object) -> None:
    ids = Ids(5).check(value)
    assert (ids.dtype, ids.shape) == (ID_DTYPE, (0,))
    assert Ids(5).from_wire(b"").shape == (0,)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ([1, 2, 3], "got 3 ids, expected at most 2"),
        ([1, 1], "got id 1 twice, expected each id once"),
        ([-1], "got -1, expected an integer from 0 to 4294967295"),
        ([1.0], "got 1.0, expected an integer from 0 to 4294967295"),
        ([True], "got True, expected an integer from 0 to 4294967295"),
        ("ab", "got 'ab', expected a list of ids"),
        (np.array([-1]), "got dtype int64 or ids beyond 32 bits, expected uint32"),
        (np.array([1.0]), "got dtype float64 or ids beyond 32 bits, expected uint32"),
        (np.zeros((1, 1), "u4"), "got 2 dimensions, expected one"),
    ],
)
def test_ids_refused(value: object, text: str) -> None:
    with pytest.raises(Refused) as caught:
        Ids(2).check(value)
    assert caught.value.text == text


def test_too_many_rows_are_refused_before_they_are_read() -> None:
    with pytest.raises(Refused, match="got 3 ids, expected at most 2"):
        Ids(2).from_wire(bytes(12))
    with pytest.raises(Refused, match="got 3 segments, expected at most 2"):
        LoadTable(2).from_wire(bytes(3 * 48))


def test_a_table_of_another_layout_is_refused() -> None:
    with pytest.raises(Refused, match="got dtype uint32, expected"):
        LoadTable(2).check(np.zeros(1, "u4"))
    with pytest.raises(Refused, match="expected held segments of dtype"):
        HeldTable(2).check([(1, 2, 3)])
