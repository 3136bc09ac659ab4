"""Writes the landings corpus: chance under a theme, with the server's own session.

python tests/conformance/landings_generate.py
"""

from __future__ import annotations

import base64
import json
import random
import sys
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from conformance.landings_steps import CORPUS, Player
from sdk.pairing import COUNT, Pair, ToyScene

from terraport_wire import Direction, decode

__all__ = ["THEMES", "history"]

THEMES: Final[dict[str, dict[str, float]]] = {
    "landings": {},
    "superseding": {"land": 0.5},
    "cuts": {"cut": 0.08},
    "damage": {"flip": 0.15},
    "missing": {"broken": 5},
    "versions": {"cut": 0.05, "versions": 2},
    "budgets": {"max_segments": 6},
    "levels": {"levels": 2},
    "refusals": {"land": 0.25, "refuse": 0.4},
}
TOO_FAR_M: Final = 501.0
"""A radius that the service refuses."""
EACH: Final = 26
STEPS: Final = 25


class _Told(Pair):
    """A pair whose client is asked by steps, which are written down."""

    def __init__(self, scene: ToyScene, **options: Any) -> None:
        super().__init__(scene, **options)
        options = {"max_segments": None} | options
        self.player = Player(**options)
        self.core = self.player.core
        self.steps: list[list[Any]] = []

    def do(self, *step: Any) -> dict[str, Any]:
        told = self.player.play(list(step))
        self.steps.append([*step, told])
        return told

    def listen(self) -> None:
        """Let one message come, if there is one."""
        if self.down:
            self.do("receive", base64.b64encode(self.down.popleft()).decode())

    def say(self) -> None:
        """Let the server hear what is due."""
        out = self.core.data_to_send
        taken: list[bytes] = []
        self.core.data_to_send = lambda: taken.extend(out()) or taken  # type: ignore[method-assign]
        told = self.do("send")
        self.core.data_to_send = out  # type: ignore[method-assign]
        if not told["sent"]:
            self.steps.pop()
        for data in taken:
            assert self.server is not None
            self.server.receive(decode(data, Direction.CLIENT_TO_SERVER), 0.0)

    def finish(self) -> None:
        """Let everything happen that will."""
        before = -1
        while before != len(self.steps) or self.down:
            before = len(self.steps)
            self.say()
            while self.serve():
                pass
            self.listen()


def history(theme: str, number: int) -> dict[str, Any]:
    """Return one history of a theme."""
    rules = THEMES[theme]
    chance = random.Random(f"{theme} {number}")
    levels = int(rules.get("levels", 1))
    scenes = [
        ToyScene(number, levels=levels, version=1 + version)
        for version in range(int(rules.get("versions", 1)))
    ]
    options = {"credit_bytes": chance.choice([150, 1000, 1 << 20])}
    if "max_segments" in rules:
        options["max_segments"] = int(rules["max_segments"])
    pair = _Told(scenes[0], **options)
    pair.broken = set(chance.sample(range(COUNT), int(rules.get("broken", 0))))
    damage = rules.get("flip", 0.0)

    def spoil(frame: bytes) -> bytes:
        return frame[:-1] + bytes([frame[-1] ^ 1]) if chance.random() < damage else frame

    pair.spoil = spoil

    def connect() -> None:
        pair.scene = chance.choice(scenes)
        _Told.connect(pair)
        pair.do("connected")

    def land() -> None:
        radius_m = chance.randint(8, 240) / 4
        if "refuse" in rules and chance.random() < rules["refuse"]:
            radius_m = TOO_FAR_M
        inner_m = radius_m / 2 if chance.random() < 0.4 else None
        ring_m = radius_m + chance.randint(1, 160) / 4 if chance.random() < 0.5 else None
        pair.do("land", [chance.randint(0, 400) / 4 for _ in range(3)], radius_m, inner_m, ring_m)

    connect()
    landings = 0
    while len(pair.steps) < STEPS:
        step = chance.random()
        if not landings or step < rules.get("land", 0.12):
            land()
            landings += 1
        elif step < 0.6 and chance.random() < rules.get("cut", 0.0):
            pair.server = None
            pair.down.clear()
            pair.do("lost")
            connect()
        elif step < 0.55 and chance.random() < 0.1:
            place = [chance.randint(0, 400) / 4 for _ in range(3)]
            pair.do(*(["pick", place] if chance.random() < 0.3 else ["aim", place, 20.0]))
        elif step < 0.6 and chance.random() < 0.2:
            pair.do("hurry", landings)
        else:
            pair.say()
            for _ in range(chance.randrange(6)):
                pair.serve()
            pair.listen()
    pair.finish()
    return {"history": f"{theme} {number}", "options": {"max_segments": None} | options,
            "steps": pair.steps}  # fmt: skip


def main() -> None:
    """Write every file."""
    for theme in THEMES:
        lines = [
            json.dumps(history(theme, number), separators=(",", ":")) for number in range(EACH)
        ]
        (CORPUS / f"{theme}.jsonl").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
