"""Histories of the landings corpus, done by the Python client's core."""

from __future__ import annotations

import base64
import dataclasses
import json
import zlib
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport.cache import SegmentCache
from terraport.core import SessionCore
from terraport.events import InnerWhole
from terraport.options import SessionOptions
from terraport_wire import Direction, decode

__all__ = ["CORPUS", "Player", "difference", "read_histories", "sent_message"]

CORPUS: Final = Path(__file__).with_name("landings")


def read_histories(path: Path) -> list[dict[str, Any]]:
    """Return the histories of one file."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def difference(history: dict[str, Any]) -> str | None:
    """Play a history; return where it goes another way, or None."""
    player = Player(**history["options"])
    for number, (*step, told) in enumerate(history["steps"]):
        if (actual := player.play(step)) != told:
            return f"step {number} {str(step)[:80]}: got {actual}, expected {told}"
    return None


class Player:
    """A client's core, and what was told of it last."""

    def __init__(self, *, credit_bytes: int, max_segments: int | None) -> None:
        options = SessionOptions("corpus", credit_bytes=credit_bytes, max_segments=max_segments)
        self.core = SessionCore(options, SegmentCache(1 << 30))
        self._shown = _picture(frozenset(), b"")

    def play(self, step: list[Any]) -> dict[str, Any]:
        """Do one step; return what came of it."""
        core, (do, *given) = self.core, step
        told: dict[str, Any] = {}
        if do == "connected":
            core.connected()
        elif do == "lost":
            core.connection_lost()
        elif do == "receive":
            core.receive(base64.b64decode(given[0]))
        elif do == "land":
            core.land(*given[:2], inner_radius_m=given[2], coarse_radius_m=given[3])
        elif do == "hurry":
            core.hurry(given[0])
        elif do == "aim":
            core.aim(*given)
            core.flush_aim()
        elif do == "pick":
            core.pick(given[0])
        elif do == "send":
            told["sent"] = [sent_message(data) for data in core.data_to_send()]
            core.sent()
        for event in core.events():
            if isinstance(event, InnerWhole):
                told["inner"] = [len(event.ids), f"{zlib.crc32(event.hidden):08x}"]
        shown = _picture(core.shown_keys, core.shown.hidden)
        told |= {name: value for name, value in shown.items() if value != self._shown[name]}
        self._shown = shown
        return told


def _picture(keys: frozenset[int], hidden: bytes) -> dict[str, Any]:
    return {"shown": [f"{key:016x}" for key in sorted(keys)], "hidden": f"{zlib.crc32(hidden):08x}"}


def sent_message(data: bytes) -> dict[str, Any]:
    message = decode(data, Direction.CLIENT_TO_SERVER)
    fields = {each.name: getattr(message, each.name) for each in dataclasses.fields(message)}
    told = {name: _plain(value) for name, value in fields.items() if value is not None}
    return {"type": message.TYPE} | told


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [f"{key:016x}" for key in sorted(value.tolist())]
    if dataclasses.is_dataclass(value):
        parts = {each.name: getattr(value, each.name) for each in dataclasses.fields(value)}
        return {name: part for name, part in parts.items() if part is not None}
    return list(value) if isinstance(value, tuple) else value
