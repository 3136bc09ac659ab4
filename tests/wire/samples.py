"""Every good message of the corpus, decoded: the codec's tests start here."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Final

from terraport_wire import Direction, Message, decode

__all__ = ["SAMPLES"]

_GOOD: Final = Path(__file__).resolve().parents[1] / "conformance" / "messages" / "good.jsonl"


def _samples() -> list[Message]:
    samples = []
    for line in _GOOD.read_text(encoding="utf-8").splitlines():
        case = json.loads(line)
        if case["case"].endswith(("minimal", "full, unknown fields")):
            is_client = case["from"] == "client"
            direction = Direction.CLIENT_TO_SERVER if is_client else Direction.SERVER_TO_CLIENT
            message = decode(base64.b64decode(case["bytes"]), direction)
            assert isinstance(message, Message)
            samples.append(message)
    return samples


SAMPLES: Final = _samples()
