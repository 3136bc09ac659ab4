"""What people call the regions of a scene: the contents of ``labels.json``.

Labels are kept by stable id, not by the region's number in one version, so they survive rebuilds;
format in ``spec/scene-format.md``, section "labels.json". Files are read and written by
:mod:`~terraport_store.labelling`.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Mapping
from typing import Any, Final

from terraport_store.errors import DamagedSceneError
from terraport_store.layout import LABELS, MAX_LABELS_BYTES

__all__ = [
    "MAX_LABELS",
    "MAX_LABEL_LENGTH",
    "MAX_STABLE_ID",
    "encode_labels",
    "label_fault",
    "parse_labels",
]

MAX_LABEL_LENGTH: Final = 256
"""Unicode code points; as many as a pick's answer carries."""

MAX_LABELS: Final = 131_072
"""Rows of labels.json: twice as many as a version can have regions."""

MAX_STABLE_ID: Final = (1 << 32) - 1
"""Stable ids are u32 on the wire."""

_FORMAT: Final = "terraport-labels"


def label_fault(label: str) -> str | None:
    """Say what is wrong with a label; None for a good one.

    Parameters
    ----------
    label : str

    Returns
    -------
    str or None
        What was received and what was expected, lower-case, no full stop.

    Examples
    --------
    >>> label_fault("haul road") is None
    True
    >>> label_fault("")
    'an empty label, expected 1 to 256 characters'
    """
    if not label:
        return f"an empty label, expected 1 to {MAX_LABEL_LENGTH} characters"
    if len(label) > MAX_LABEL_LENGTH:
        return f"a label of {len(label)} characters, expected at most {MAX_LABEL_LENGTH}"
    for position, character in enumerate(label):
        kind = unicodedata.category(character)
        if kind in ("Cc", "Cs"):
            what = "control character" if kind == "Cc" else "half of a character"
            return (
                f"a label with the {what} U+{ord(character):04X} at {position + 1}, expected text"
            )
    if label != label.strip():
        return f"a label with a blank at an end ({label!r}), expected none"
    return None


def encode_labels(labels: Mapping[int, str]) -> bytes:
    """Write labels.json; same labels, same bytes.

    Parameters
    ----------
    labels : mapping of int to str
        Label by stable id; every label without a fault.

    Returns
    -------
    bytes

    Examples
    --------
    >>> parse_labels(encode_labels({7: "Süd", 2: "haul road"}))
    {2: 'haul road', 7: 'Süd'}
    """
    rows = [{"stable_id": number, "label": labels[number]} for number in sorted(labels)]
    lines = ",\n  ".join(json.dumps(row, ensure_ascii=False) for row in rows)
    body = f"\n  {lines}\n " if rows else ""
    return (f'{{"format": "{_FORMAT}", "format_version": "1.0",\n "labels": [{body}]}}\n').encode()


def parse_labels(data: bytes) -> dict[int, str]:
    """Read labels.json.

    Parameters
    ----------
    data : bytes
        The whole file.

    Returns
    -------
    dict of int to str
        Label by stable id, ascending.

    Raises
    ------
    DamagedSceneError
        Naming what is wrong, and in which row.
    """
    if len(data) > MAX_LABELS_BYTES:
        raise _damaged(f"{len(data)} bytes, expected at most {MAX_LABELS_BYTES}")
    try:
        document = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise _damaged(f"does not parse as JSON: {error}") from None
    if not isinstance(document, dict) or document.get("format") != _FORMAT:
        received = document.get("format") if isinstance(document, dict) else type(document).__name__
        raise _damaged(f"format {received!r}, expected {_FORMAT!r}")
    version = document.get("format_version")
    if not isinstance(version, str) or version.partition(".")[0] != "1":
        raise _damaged(f"format_version {version!r}, expected 1.x")
    rows = document.get("labels")
    if not isinstance(rows, list):
        raise _damaged(f"labels are a {type(rows).__name__}, expected a list")
    if len(rows) > MAX_LABELS:
        raise _damaged(f"{len(rows)} labels, expected at most {MAX_LABELS}")
    labels: dict[int, str] = {}
    before = -1
    for row_number, row in enumerate(rows):
        number, label = _row(row_number, row)
        if number <= before:
            raise _damaged(
                f"row {row_number}: stable_id {number} after {before}, expected ascending"
            )
        before, labels[number] = number, label
    return labels


def _row(row_number: int, row: Any) -> tuple[int, str]:
    number = row.get("stable_id") if isinstance(row, dict) else None
    label = row.get("label") if isinstance(row, dict) else None
    # bool is an int in Python; true is no number in JSON.
    if type(number) is not int or not 0 <= number <= MAX_STABLE_ID:
        raise _damaged(f"row {row_number}: stable_id {number!r}, expected 0 to {MAX_STABLE_ID}")
    if not isinstance(label, str):
        raise _damaged(f"row {row_number}: label {label!r}, expected text")
    fault = label_fault(label)
    if fault is not None:
        raise _damaged(f"row {row_number}: {fault}")
    return number, label


def _damaged(what: str) -> DamagedSceneError:
    return DamagedSceneError(LABELS, what)
