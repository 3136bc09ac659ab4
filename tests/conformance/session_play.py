"""A script played by the Python client's state machine against the server's: one history.

A script is a list of small operations (the client lands, the line is cut, the server acts, a bit is
flipped), so that it can be made by chance and shrunk; what comes of it is decided by the two state
machines alone. PURE: no clock, no chance.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from conformance.session_groups import GroupHall
from conformance.session_steps import Step, ToldSession
from sdk.pairing import Pair, ToyScene

from terraport import events as told
from terraport.session import ClientSession
from terraport_server.session.interface import SendChunk, SessionLimits
from terraport_wire import Hit, PayloadFrame, encode_frame

__all__ = ["Operation", "Script", "World", "play"]

Operation = tuple[Any, ...]
MOST_STEPS: Final = 4000
LIMITS: Final = {"max_radius_m": 9.0, "max_picks": 2, "max_messages_per_s": 1e6}
HIT: Final = Hit(
    position=(0, 0, 0), normal=(0, 1, 0), segment=3, region=1, height_m=9.0, attributes={}
)


@dataclass(frozen=True)
class Script:
    """What happens, and under which options."""

    options: dict[str, Any]
    """Of the client."""
    limits: dict[str, Any] = field(default_factory=dict)
    """Of the server."""
    operations: tuple[Operation, ...] = ()
    levels: int = 1
    """Of the scenes."""


def _scene(version: str, changed: int, levels: int = 1) -> ToyScene:
    random = np.random.default_rng(7)
    payloads = [random.bytes(int(size)) for size in random.integers(4, 40, 36 * levels)]
    for segment in range(0, changed * 5, 5):
        payloads[segment] = bytes(reversed(payloads[segment])) + b"!"
    return ToyScene(version=version, payloads=payloads, levels=levels)


ONE_LEVEL: Final = (_scene("v1", 0), _scene("v2", 4))
SCENES: Final = {1: ONE_LEVEL, 2: (_scene("v1", 0, 2), _scene("v2", 4, 2), _scene("v3", 4))}
"""What is served, by its levels: the versions that a script may connect to, by number."""


def _situation(session: ClientSession) -> str:
    """In what situation a client is: a letter for each thing that holds."""
    transfers = session._transfers
    facts = {
        "u": session._unsent is not None,
        "w": transfers.awaits_plan,
        "o": len(transfers.open_plan) > 0,
        "a": transfers._prefetch is not None,
        "g": len(session.holdings._gone) > 0,
        "r": len(transfers._retried) > 0,
        "n": len(transfers._nearby) > 0,
        "i": len(transfers._inner) > 0,
        "q": session._queued is not None,
        "s": session.group._seated,
        "j": session.group._join is not None,
        "h": len(session.group._gathers) > 0,
        "c": session.group._arrived is not None,
    }
    return "".join(letter for letter, holds in facts.items() if holds)


class _Told:
    """The session as `Pair` uses it, with every call told."""

    def __init__(self, client: ToldSession) -> None:
        self._client = client
        self._events: list[told.Event] = []
        self.situations: list[str] = []
        """After each step."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._client.session, name)

    def perform(self, *do: Any) -> Step:
        step = self._client.perform(list(do))
        self._events += self._client.events
        self.situations.append(_situation(self._client.session))
        return step

    def events(self) -> list[told.Event]:
        events, self._events = self._events, []
        return events

    def connected(self, *, offer_held: bool = True) -> None:
        self.perform("connected", offer_held)

    def connection_lost(self) -> None:
        self.perform("lost")

    def receive(self, data: bytes) -> None:
        self.perform("receive", base64.b64encode(data).decode())

    def data_to_send(self) -> list[bytes]:
        step = self.perform("take")
        if "out" not in step:  # a history has no empty steps
            self._client.steps.pop()
            self.situations.pop()
        return [base64.b64decode(text) for text in step.get("out", [])]


class World(Pair):
    """One client, one server, and what is between them."""

    def __init__(self, script: Script) -> None:
        client = ToldSession(script.options)
        self.scenes = SCENES[script.levels]
        super().__init__(self.scenes[0], limits=SessionLimits(**LIMITS | script.limits))
        self.told = client
        self.client: Any = _Told(client)
        self.hit = HIT
        self.heard: list[bytes] = []
        self.spoilt = 0
        self.failing: set[int] = set()
        self.hall = GroupHall()
        self.spoil = self._spoil

    def _spoil(self, frame: PayloadFrame) -> bytes:
        data = bytearray(encode_frame(frame))
        if self.spoilt and frame.offset + len(frame.chunk) == frame.total:
            self.spoilt -= 1
            data[-1] ^= 1
        return bytes(data)

    def _carry_out(self, action: object) -> None:
        if isinstance(action, SendChunk) and action.segment in self.failing:
            assert self.server is not None
            self.server.payload_failed(action, self.now_s)
            return
        super()._carry_out(action)

    def connect(self) -> None:
        self.groups = self.hall.door()
        super().connect()

    def disconnect(self) -> None:
        self.hall.lost(self.now_s)
        super().disconnect()

    def serve(self) -> bool:
        self.hall.hand_out(self.server)
        return super().serve()

    def hear(self) -> None:
        """What the client finds wrong ends the connection."""
        if not self.down:
            return
        self.heard.append(bytes(self.down[0]))
        super().hear()
        if self.told.steps[-1].get("violation"):
            self.disconnect()

    # ---- operations

    def do_connect(self, offer: bool, scene: int) -> None:
        if self.server is not None:
            self.disconnect()
        self.scene, self.offer_held = self.scenes[scene], offer
        self.connect()

    def do_cut(self) -> None:
        if self.server is not None:
            self.disconnect()

    def do_pump(self, count: int) -> None:
        for _ in range(count):
            if not self.step():
                break

    def do_serve(self, count: int) -> None:
        for _ in range(count):
            if not self.serve():
                break

    def do_hear(self, count: int) -> None:
        for _ in range(count):
            self.hear()

    def do_take(self) -> None:
        if self.server is not None:
            self.deliver()

    def do_lag(self, count: int) -> None:
        self.lag = count

    def do_flip(self, count: int) -> None:
        self.spoilt = count

    def do_fail(self, segment: int) -> None:
        self.failing ^= {segment}

    def do_wait(self, seconds: float) -> None:
        self.now_s += seconds
        self.hall.groups.tick(self.now_s)
        if self.server is not None:
            self.server.tick(self.now_s)

    def do_publish(self) -> None:
        if self.server is not None:
            self.server.scene_published("v2")

    def do_drain(self) -> None:
        if self.server is not None:
            self.server.drain(self.now_s, 5.0)

    def do_other(self, *what: Any) -> None:
        self.hall.other(self.now_s, *what)

    def do_call(self, *do: Any) -> None:
        self.client.perform(*do)
        self._collect()

    def do_again(self, back: int) -> None:
        """What came before comes again; prefetches excepted, which clients may refuse or take."""
        if len(self.heard) < back or b"prefetch" in self.heard[-back]:
            return
        self._stray(self.heard[-back])

    def do_stray(self, data: str) -> None:
        self._stray(base64.b64decode(data))

    def do_text(self, text: str) -> None:
        self._ended_by(lambda: self.client.perform("text", text))

    def _stray(self, data: bytes) -> None:
        self._ended_by(lambda: self.client.receive(data))

    def _ended_by(self, call: Callable[[], object]) -> None:
        call()
        self._collect()
        if self.told.steps[-1].get("violation") and self.server is not None:
            self.disconnect()
        elif self.told.steps[-1].get("violation"):
            self.do_call("lost")

    @property
    def is_long(self) -> bool:
        """Whether it went on for longer than any history should."""
        return len(self.told.steps) > MOST_STEPS


def play(script: Script) -> tuple[list[Step], World]:
    """Play a script, and then let everything happen that will.

    Returns
    -------
    steps : list of dict
        The history.
    world : World
        How it stands at the end.
    """
    world = World(script)
    for name, *arguments in script.operations:
        getattr(world, f"do_{name}")(*arguments)
        assert not world.is_long, script
    world.lag = world.spoilt = 0
    world.settle()
    world.do_call("flush")  # as links do, whether an aim waits or not
    world.settle()
    world.do_call("take")  # nothing: whoever has more to say than it should is found here
    assert not world.is_long, script
    return world.told.steps, world
