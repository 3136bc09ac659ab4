"""Fuzz a running service, and the session core: ``python fuzz/server.py``.

::

    python fuzz/server.py --seconds 5                 # what CI runs: a little of everything
    python fuzz/server.py --messages 1000000          # the real run: about half an hour
    python fuzz/server.py --seconds 600 --seed 7

Five attacks, each from a fixed seed:

* **core**: valid, edited and broken messages into the pure session core, driven as the sender
  drives it;
* **truncated**: every proper prefix of every valid message of the conformance corpus,
  into the core, and over real sockets, before and after hello;
* **messages**: the mix of the first over real sockets, several connections at once;
* **frames**: WebSocket frames that are legal but odd, and every kind of illegal one;
* **http**: requests with hostile paths, headers and bodies, and bytes that are no HTTP.

The service is ``terraport serve`` as a process of its own. It passes where nothing escapes the
core; every connection is answered or closed within a bound, with documented error and close codes
only; the process lives, has no error in its log, has not grown by more than ``--growth-mb``; and a
landing works afterwards as before. What is wrong is printed with what is needed to repeat it.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any, Final

# The service as a process, and a client that checks everything, are those of the benchmarks.
sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))

from attacks.core import CoreRun, fuzz_core, make_view, take_alone
from attacks.http_cases import CANARY, hostile_request, judge
from attacks.messages import Corpus, sensible, sensible_hello
from attacks.peers import Answers, HostilePeer
from attacks.scene import EDGE_M, SEGMENTS, write_small_scene
from attacks.websocket_cases import hostile_frames, random_frames
from parts.light_client import Findings, LightClient
from parts.service_process import ServiceProcess

from terraport_store import Scene
from terraport_wire import Bye, Credit, encode

THREADS: Final = 6
SCENE: Final = "pit"
ATTACKS: Final = ("core", "core_truncated", "truncated", "messages", "frames", "http")

Case = Callable[[], "tuple[int, list[str], str]"]
"""Returns how many messages it was, what is wrong, and a name that tells one answer from others."""


class Budget:
    """How much of one attack: by time, by number, or both."""

    def __init__(self, seconds: float | None, count: int | None) -> None:
        self._until_s = None if seconds is None else time.monotonic() + seconds
        self._count = count
        self.done = 0

    def more(self) -> bool:
        """Whether time and number allow another case."""
        in_time = self._until_s is None or time.monotonic() < self._until_s
        return in_time and (self._count is None or self.done < self._count)


def attack_core(corpus: Corpus, budget: Budget, seed: int) -> CoreRun:
    """Sessions, one after the other, each from a seed of its own."""
    run, view, number = CoreRun(), make_view(seed), 0
    while budget.more():
        draw = random.Random(f"core {seed} {number}")
        try:
            fuzz_core(corpus, draw, view, run)
        except Exception:
            print(f"core: session {number} of seed {seed}", file=sys.stderr)
            raise
        number += 1
        budget.done = run.messages
    return run


def attack_core_truncated(corpus: Corpus, budget: Budget, seed: int) -> CoreRun:
    """Every truncation, or as many as there is time for."""
    run, view = CoreRun(), make_view(seed)
    for data in _truncations(corpus, seed):
        if not budget.more():
            break
        try:
            take_alone(data, view, run)
        except Exception:
            print(f"core: truncated {data!r}", file=sys.stderr)
            raise
        budget.done = run.messages
    return run


def socket_truncated(port: int, data: bytes, draw: random.Random) -> tuple[int, list[str], str]:
    """One truncation as the second message, or as the first, of a connection."""
    answers = Answers()
    with HostilePeer(port) as peer:
        peer.handshake(SCENE, answers)
        messages: list[bytes] = [data, encode(Bye())]
        if draw.random() < 0.8:
            messages.insert(0, encode(sensible_hello(draw)))
        peer.send(*messages)
        peer.until_closed(answers)
    return len(messages), answers.wrong, _name(answers)


def socket_messages(corpus: Corpus, port: int, draw: random.Random) -> tuple[int, list[str], str]:
    """One connection's life: hello, a mix, bye."""
    answers = Answers()
    messages: list[bytes] = [encode(sensible_hello(draw))]
    if draw.random() < 0.05:
        messages = [corpus.edited(draw)]
    hostility = draw.choice([0.0, 0.02, 0.02, 0.3])
    for generation in range(draw.randint(1, 60)):
        if draw.random() < hostility:
            edit = corpus.edited if draw.random() < 0.7 else corpus.broken
            messages.append(edit(draw))
        else:
            message = sensible(draw, generation, segments=SEGMENTS, edge_m=EDGE_M)
            messages.append(encode(message))
    messages.append(encode(Bye()))
    with HostilePeer(port) as peer:
        peer.handshake(SCENE, answers)
        if draw.random() < 0.05:  # vanish in the middle
            peer.send(*messages)
            return len(messages), answers.wrong, "vanished"
        peer.send(*messages)
        peer.until_closed(answers)
    return len(messages), answers.wrong, _name(answers)


def socket_frames(port: int, name: str, data: bytes) -> tuple[int, list[str], str]:
    """One connection that breaks the rules of WebSocket."""
    answers = Answers()
    with HostilePeer(port) as peer:
        peer.handshake(SCENE, answers)
        peer.send(encode(sensible_hello(random.Random(1))))
        peer.write(data)
        peer.finish(answers, quiet_s=0.1)
    if answers.close_code is not None and answers.close_code.to_bytes(2, "big") in data:
        answers.wrong.clear()  # the service gives back the code of the client's own close
    return 2, [f"{name}: {what}" for what in answers.wrong], _name(answers)


def socket_http(port: int, request: bytes) -> tuple[int, list[str], str]:
    """One connection that speaks HTTP, or nearly."""
    with HostilePeer(port) as peer:
        peer.write(request)
        peer.finish(Answers(), quiet_s=0.05)
        answer = peer.inbox
    wrong = [f"{what}; the request was {request[:2000]!r}" for what in judge(answer)]
    words = answer.split(None, 2)
    return 1, wrong, words[1].decode("latin-1") if len(words) > 1 else "closed"


def run_cases(cases: Iterator[Case], budget: Budget, wrong: list[str]) -> dict[str, Any]:
    """Run cases in several threads while the budget lasts; count their outcomes."""
    outcomes: Counter[str] = Counter()
    began_s, connections = time.monotonic(), 0
    with ThreadPoolExecutor(THREADS) as pool:
        while budget.more() and len(wrong) < 20:
            batch = list(islice(cases, 8 * THREADS))
            if not batch:
                break
            for count, problems, name in pool.map(_safely, batch):
                budget.done += count
                connections += 1
                outcomes[name] += 1
                wrong += problems
    return {
        "messages": budget.done,
        "connections": connections,
        "seconds": round(time.monotonic() - began_s, 1),
        "outcomes": dict(outcomes.most_common()),
    }


def _safely(case: Case) -> tuple[int, list[str], str]:
    try:
        return case()
    except (AssertionError, OSError, ValueError) as error:  # a hang, a refused connection
        return 1, [f"{type(error).__name__}: {error}"], "wrong"


def _truncations(corpus: Corpus, seed: int) -> list[bytes]:
    """All of them, in an order that shows a bit of everything first."""
    truncations = list(corpus.truncations())
    random.Random(seed).shuffle(truncations)
    return truncations


def _name(answers: Answers) -> str:
    """Name an outcome: the close code, and the last error."""
    code = "none" if answers.close_code is None else str(answers.close_code)
    return f"{code} {answers.errors[-1]}" if answers.errors else code


async def land_once(url: str, scene: Scene) -> list[str]:
    """Land as a client of good manners; return what is wrong."""
    findings = Findings()
    client = LightClient(url, scene.index, findings, name="after")
    await client.connect()
    async with asyncio.timeout(30):
        await client.land((EDGE_M / 2, 0.0, EDGE_M / 2), 200.0)
    if findings.segments != SEGMENTS:
        findings.say(f"{findings.segments} segments, expected {SEGMENTS}")
    await client.leave()
    return findings.wrong


def attack_service(
    corpus: Corpus,
    port: int,
    seed: int,
    budgets: dict[str, Callable[[], Budget]],
    wrong: list[str],
    share: tuple[int, int],
) -> dict[str, Any]:
    """All attacks over sockets; of the truncations only every n-th, from the k-th on."""

    def draws(name: str) -> Iterator[random.Random]:
        number = 0
        while True:
            yield random.Random(f"{name} {seed} {number}")
            number += 1

    def truncated() -> Iterator[Case]:
        every = _truncations(corpus, seed)[share[0] :: share[1]]
        pairs = zip(every, draws("truncated"), strict=False)
        for data, draw in pairs:
            yield lambda d=data, r=draw: socket_truncated(port, d, r)

    def messages() -> Iterator[Case]:
        for draw in draws("messages"):
            yield lambda r=draw: socket_messages(corpus, port, r)

    def frames() -> Iterator[Case]:
        message = encode(Credit(bytes=5))
        for name, data in hostile_frames(message):
            yield lambda n=name, d=data: socket_frames(port, n, d)
        for draw in draws("frames"):
            data = random_frames(message, draw)
            yield lambda d=data: socket_frames(port, f"frames {d[:500].hex()}", d)

    def http() -> Iterator[Case]:
        for draw in draws("http"):
            data = hostile_request(draw)
            yield lambda d=data: socket_http(port, d)

    attacks = {"truncated": truncated, "messages": messages, "frames": frames, "http": http}
    return {
        name: run_cases(attack(), budgets[name](), wrong)
        for name, attack in attacks.items()
        if len(wrong) < 20 and budgets[name]().more()
    }


def make_budgets(arguments: argparse.Namespace) -> dict[str, Callable[[], Budget]]:
    """Return how much of each attack, as a function: its time begins when it is called."""
    seconds: float | None = arguments.seconds
    if arguments.messages is None:
        shares = {"core": 0.2, "core_truncated": 0.1, "truncated": 0.2, "messages": 0.2}
        shares |= {"frames": 0.15, "http": 0.15}
        return {
            name: lambda share=share: Budget(share * (seconds or 60.0), None)
            for name, share in shares.items()
        }
    counts = {"core": 0.6, "messages": 0.3, "frames": 0.01, "http": 0.005}
    budgets: dict[str, Callable[[], Budget]] = {
        name: lambda share=share: Budget(None, round(share * arguments.messages))
        for name, share in counts.items()
    }
    return budgets | {name: lambda: Budget(None, None) for name in ("core_truncated", "truncated")}


def main() -> int:
    form = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--seconds", type=float, help="time of all attacks together")
    parser.add_argument("--messages", type=int, help="so many messages, and all truncations")
    parser.add_argument("--only", choices=ATTACKS, action="append", help="repeatable")
    parser.add_argument("--part", default="0/1", help="K/N: every N-th truncation over sockets")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--growth-mb", type=float, default=64.0)
    parser.add_argument("--log", type=Path, help="where the service's log goes")
    arguments = parser.parse_args()
    # What is not asked for gets a budget of nothing, so that every run reports all attacks.
    first, step = (int(number) for number in arguments.part.split("/"))
    corpus, budgets, wrong = Corpus(), make_budgets(arguments), []
    for name in ATTACKS:
        if arguments.only and name not in arguments.only:
            budgets[name] = lambda: Budget(None, 0)
    result: dict[str, Any] = {"seed": arguments.seed}
    # The session alone, in this process.
    for name, attack in (("core", attack_core), ("core_truncated", attack_core_truncated)):
        began_s = time.monotonic()
        run = asdict(attack(corpus, budgets[name](), arguments.seed))
        result[name] = run | {"seconds": round(time.monotonic() - began_s, 1)}
    # A service in a process of its own; the canary lies where no request may reach.
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        folder = Path(name)
        (folder / "canary").write_text(CANARY, encoding="ascii")
        (folder / "scenes").mkdir()
        write_small_scene(folder / "scenes" / SCENE)
        log = arguments.log or folder / "log"
        settings = {"max_messages_per_s": 1e9, "max_sessions_per_ip": 1000, "log_level": "warning"}
        with (
            ServiceProcess(folder / "scenes", log=log, **settings) as service,
            Scene.open(folder / "scenes" / SCENE) as scene,
        ):
            url = f"{service.url}/scenes/{SCENE}"
            # A landing works before; after all attacks the same must hold, without growth.
            wrong += asyncio.run(land_once(url, scene))
            before = service.memory()
            result |= attack_service(
                corpus, service.port, arguments.seed, budgets, wrong, (first, step)
            )
            if not service.alive:
                wrong.append("the service is dead")
            else:
                wrong += asyncio.run(land_once(url, scene))
                time.sleep(0.5)
                after = service.memory()
                result["rss_mb"] = [round(sample.rss / 1e6, 1) for sample in (before, after)]
                result["descriptors"] = [before.descriptors, after.descriptors]
                if after.rss - before.rss > 1e6 * arguments.growth_mb:
                    wrong.append(f"RSS grew from {before.rss} to {after.rss}")
        # Whatever the service could not explain is in its log.
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
        wrong += [line for line in lines if " error " in line or "Traceback" in line][:5]
    attacks = [entry for entry in result.values() if isinstance(entry, dict)]
    result["messages_in_all"] = sum(entry["messages"] for entry in attacks)
    result["wrong"] = wrong
    print(json.dumps(result, indent=1))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
