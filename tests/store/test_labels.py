"""The contents of labels.json, both ways."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport_store import DamagedSceneError
from terraport_store.labels import (
    MAX_LABEL_LENGTH,
    MAX_STABLE_ID,
    encode_labels,
    label_fault,
    parse_labels,
)

LITERAL = """{"format": "terraport-labels", "format_version": "1.0",
 "labels": [
  {"stable_id": 0, "label": "haul road"},
  {"stable_id": 7, "label": "Süd \\"A\\""}
 ]}
"""

good_labels = st.text(min_size=1, max_size=MAX_LABEL_LENGTH).filter(lambda t: not label_fault(t))


def test_literal_bytes_both_ways() -> None:
    labels = {7: 'Süd "A"', 0: "haul road"}
    assert encode_labels(labels) == LITERAL.encode()
    assert parse_labels(LITERAL.encode()) == {0: "haul road", 7: 'Süd "A"'}
    assert parse_labels(encode_labels({})) == {}


@given(st.dictionaries(st.integers(0, MAX_STABLE_ID), good_labels, max_size=20))
def test_round_trip(labels: dict[int, str]) -> None:
    parsed = parse_labels(encode_labels(labels))
    assert parsed == labels
    assert list(parsed) == sorted(labels)
    shuffled = dict(sorted(labels.items(), key=lambda item: item[1]))
    assert encode_labels(shuffled) == encode_labels(labels)


def test_every_truncation_is_noticed() -> None:
    data = LITERAL.encode().rstrip()
    for length in range(len(data)):
        with pytest.raises(DamagedSceneError):
            parse_labels(data[:length])


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"format": "terraport-scene"}, "format 'terraport-scene', expected 'terraport-labels'"),
        ({"format_version": "2.0"}, "format_version '2.0', expected 1.x"),
        ({"labels": {"7": "x"}}, "labels are a dict, expected a list"),
        ({"labels": [7]}, "row 0: stable_id None, expected 0 to"),
        ({"labels": [{"stable_id": True, "label": "x"}]}, "row 0: stable_id True, expected 0 to"),
        ({"labels": [{"stable_id": 2**32, "label": "x"}]}, "stable_id 4294967296, expected 0 to"),
        ({"labels": [{"stable_id": 1, "label": 5}]}, "row 0: label 5, expected text"),
        ({"labels": [{"stable_id": 1, "label": ""}]}, "row 0: an empty label, expected 1 to 256"),
        (
            {"labels": [{"stable_id": 1, "label": "x"}, {"stable_id": 1, "label": "y"}]},
            "row 1: stable_id 1 after 1, expected ascending",
        ),
    ],
)
def test_what_is_wrong_is_named(change: dict[str, Any], text: str) -> None:
    document = {**json.loads(LITERAL), **change}
    with pytest.raises(DamagedSceneError, match=r"^labels\.json: ") as caught:
        parse_labels(json.dumps(document).encode())
    assert text in str(caught.value)


def test_unknown_keys_are_skipped() -> None:
    document = json.loads(LITERAL)
    document["later"] = 1
    document["labels"][0]["colour"] = "red"
    document["format_version"] = "1.7"
    assert parse_labels(json.dumps(document).encode())[0] == "haul road"


@pytest.mark.parametrize(
    ("label", "text"),
    [
        ("x" * 257, "a label of 257 characters, expected at most 256"),
        ("two\nlines", "control character U+000A at 4"),
        ("a\x85b", "control character U+0085 at 2"),
        ("\ud800", "half of a character U+D800 at 1"),
        (" road", "a blank at an end (' road'), expected none"),
        ("", "an empty label"),
    ],
)
def test_bad_labels(label: str, text: str) -> None:
    fault = label_fault(label)
    assert fault is not None
    assert text in fault


@pytest.mark.parametrize("label", ["x" * 256, "石" * 256, "𝄞" * 256, "a b", "=1+1"])
def test_good_labels(label: str) -> None:
    """Length is counted in code points, as on the wire."""
    assert label_fault(label) is None
