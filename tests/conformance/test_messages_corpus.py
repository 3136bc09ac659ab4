"""The Python decoder runs the messages corpus; the corpus is what the generator writes."""

from __future__ import annotations

import base64
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from terraport_wire import (
    MESSAGES,
    DecodeError,
    Direction,
    FieldError,
    Unknown,
    decode,
    decode_frame,
    encode,
    is_payload,
)

CORPUS = Path(__file__).with_name("messages")
CASES = [
    json.loads(line)
    for path in sorted(CORPUS.glob("*.jsonl"))
    for line in path.read_text(encoding="utf-8").splitlines()
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case['from']}: {case['case']}")
def test_case(case: dict[str, Any]) -> None:
    expected = {name: case[name] for name in ("message", "frame", "skip", "error") if name in case}
    if "refused_by" in case:
        expected["refused"] = True
    assert _read(case) == expected


def test_what_is_read_is_written_as_the_same() -> None:
    for case in CASES:
        if "message" in case:
            direction = _direction(case)
            message = decode(_data(case), direction)
            assert decode(encode(message), direction) == message


def test_every_message_is_there_good_and_bad() -> None:
    for direction, sender in (
        (Direction.CLIENT_TO_SERVER, "client"),
        (Direction.SERVER_TO_CLIENT, "server"),
    ):
        names = {case["case"] for case in CASES if case["from"] == sender}
        for message in MESSAGES[direction]:
            assert {f"{message}: minimal", f"{message}: cut"} <= names


def test_the_corpus_is_small_and_what_the_script_writes() -> None:
    assert len(CASES) <= 250
    script = str(CORPUS.with_name("messages_generate.py"))
    assert subprocess.run([sys.executable, script, "--check"], check=False).returncode == 0


def _data(case: dict[str, Any]) -> bytes:
    return base64.b64decode(case["bytes"]).ljust(
        case.get("pad_to", 0), bytes([case.get("pad_byte", 0)])
    )


def _direction(case: dict[str, Any]) -> Direction:
    is_client = case["from"] == "client"
    return Direction.CLIENT_TO_SERVER if is_client else Direction.SERVER_TO_CLIENT


def _read(case: dict[str, Any]) -> dict[str, Any]:
    """Decode a case; return what came of it, in the terms of the corpus."""
    data, direction = _data(case), _direction(case)
    try:
        if is_payload(data) or case["case"].startswith("frame:"):
            frame = decode_frame(data)
            return {"skip": True} if frame is None else {"frame": _frame(frame)}
        message = decode(data, direction)
    except DecodeError as error:
        refused: dict[str, Any] = {"refused": True}
        if "error" in case:
            refused["error"] = {"code": error.code, "fatal": error.fatal}
            if isinstance(error, FieldError):
                numbers = {"generation": error.generation, "request": error.request}
                refused["error"] |= {"field": error.field}
                refused["error"] |= {k: v for k, v in numbers.items() if v is not None}
        return refused
    if isinstance(message, Unknown):
        return {"skip": True}
    return {"message": _plain(msgpack.unpackb(encode(message)))}


def _frame(frame: Any) -> dict[str, Any]:
    return {
        "generation": frame.generation,
        "key": f"{frame.key:016x}",
        "offset": frame.offset,
        "total": frame.total,
        "data": base64.b64encode(frame.data).decode(),
    }


def _plain(value: Any) -> Any:
    if isinstance(value, bytes | np.ndarray):
        return base64.b64encode(bytes(value)).decode()
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list) else value
