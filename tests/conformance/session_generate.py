"""Write the session corpus: ``python tests/conformance/session_generate.py [--check]``.

Scripts are made by chance (fixed seeds) for each of the themes below and played
(``session_play.py``). What one shows is a set of triples: what three steps in a row did, told in
words, and in what situation the client was after the first. A script that shows a triple which no script before it showed is shrunk, by leaving
operations out for as long as it still shows it, and kept: a history is short, and each is there
for something. What :func:`check` says must be true of every one, kept or not.
What chance seldom makes stands in ``named.jsonl``.

The files are the same on every run. ``--check`` compares them and writes nothing. ``--seeds N``
plays N scripts of each theme and checks them alone: to look for faults.
"""

from __future__ import annotations

import argparse
import base64
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from random import Random
from typing import Any, Final

if __name__ == "__main__":  # run as a script: the package "conformance" lies in tests/
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from conformance.session_play import Operation, Script, World, play
from conformance.session_steps import Step

from terraport_wire import (
    DecodeError,
    Direction,
    PayloadFrame,
    Superseded,
    Unknown,
    decode,
    decode_frame,
    encode,
    encode_frame,
    is_payload,
)

CORPUS: Final = Path(__file__).resolve().parent / "session"
KEPT: Final = 100
"""Histories of a theme."""
MOST_STEPS: Final = 50
"""Of a history that is kept."""

Make = Callable[[Random], Operation]


def _place(chance: Random) -> list[int]:
    """Few places: what happens at one meets what happened there before."""
    return [chance.choice((0, 2, 10)), 0, chance.choice((0, 1))]


def _land(chance: Random) -> Operation:
    return ("call", "land", _place(chance), chance.choice((0.5, 1.5, 2.5, 3.5)), None, None)


def _urgent_land(chance: Random) -> Operation:
    return ("call", "land", _place(chance), chance.choice((2.5, 3.5)), 1.5, 100)


def _far_land(chance: Random) -> Operation:
    return ("call", "land", _place(chance), 9.5, None, None)


def _aim(chance: Random) -> Operation:
    return ("call", "aim", _place(chance), chance.choice((0.5, 1.5, 2.5)))


def _far_aim(chance: Random) -> Operation:
    return ("call", "aim", _place(chance), 9.5)


def _pick(chance: Random) -> Operation:
    return ("call", "pick", [1, 2, 3], chance.choice((None, [0, -1, 0])))


def _impossible(chance: Random) -> Operation:
    bad = chance.choice((0, -1, "nan", "inf"))
    nowhere = [0, chance.choice(("nan", "inf", "-inf")), 0]
    given: tuple[tuple[Any, ...], ...] = (
        ("land", [0, 0, 0], bad, None, None),
        ("land", nowhere, 1, None, None),
        ("land", [0, 0, 0], 1, 2, None),
        ("land", [0, 0, 0], 1, None, 5),
        ("aim", [0, 0, 0], bad),
        ("aim", nowhere, 1),
        ("pick", nowhere, None),
        ("pick", [0, 0, 0], [0, 0, 0]),
    )
    return ("call", *chance.choice(given))


def _stray(chance: Random) -> Operation:
    generation = chance.randrange(1, 5)
    chunk = memoryview(bytes(3))
    frame = PayloadFrame(generation, chance.randrange(36), chance.choice((0, 1)), 9, chunk)
    superseded = Superseded(generation=generation, by=generation + 1, unsent_bytes=0)
    strays = (
        b"\x81\xa4type\xa3new",
        b"\x05\x01\x02\x03",  # a frame of a later kind
        b"",
        b"\xc1",
        encode_frame(frame),
        encode(superseded),
    )
    return ("stray", base64.b64encode(chance.choice(strays)).decode())


def _made(name: str, *choices: Sequence[Any]) -> Make:
    return lambda chance: (name, *(chance.choice(values) for values in choices))


OPERATIONS: Final[dict[str, Make]] = {
    "land": _land,
    "urgent": _urgent_land,
    "far": _far_land,
    "aim": _aim,
    "far aim": _far_aim,
    "flush": lambda _: ("call", "flush"),
    "pick": _pick,
    "impossible": _impossible,
    "bye": lambda _: ("call", "bye"),
    "pump": _made("pump", (1, 2, 3, 5, 8, 13, 40)),
    "serve": _made("serve", (1, 2, 5)),
    "hear": _made("hear", (1, 2, 5)),
    "take": lambda _: ("take",),
    "lag": _made("lag", (0, 1, 4, 20)),
    "cut": lambda _: ("cut",),
    "connect": _made("connect", (True, True, False), (0,)),
    "newer": _made("connect", (True, False), (1,)),
    "flip": _made("flip", (1, 2, 3)),
    "fail": _made("fail", range(36)),
    "wait": _made("wait", (0.2,)),
    "publish": lambda _: ("publish",),
    "drain": lambda _: ("drain",),
    "stray": _stray,
    "text": lambda _: ("text", "{}"),
    "again": _made("again", range(1, 9)),
}

MOVES: Final = "land land pump pump pump serve hear take lag"

THEMES: Final[dict[str, str]] = {
    "landings": f"{MOVES} far impossible bye",
    "aims": f"{MOVES} aim aim flush flush flush far connect",
    "cuts": f"{MOVES} cut connect connect aim flush aim flush pick",
    "flips": f"{MOVES} flip flip flip aim flush connect",
    "deadlines": f"{MOVES} urgent urgent urgent wait wait flip fail",
    "versions": f"{MOVES} newer connect aim flush publish drain",
    "missing": f"{MOVES} fail fail fail flip aim flush",
    "picks": f"{MOVES} pick pick pick connect impossible cut",
    "refusals": f"{MOVES} far far aim flush connect impossible far",
    "strays": f"{MOVES} stray stray again again connect aim flush text",
}
"""What may happen in each, as often as it is named."""


_HERE: Final = ("call", "land", [0, 0, 0], 2.5, None, None)
_THERE: Final = ("call", "land", [10, 0, 0], 2.5, None, None)
_INNER: Final = ("call", "land", [2, 0, 0], 2.5, 1.5, 100)
_AIM: Final = (("call", "aim", [0, 0, 0], 2.5), ("call", "flush"))
_AGAIN: Final = (("cut",), ("connect", True, 0))
_AWAY: Final = (("take",), ("serve", 40))

NAMED: Final[dict[str, tuple[Operation, ...]]] = {
    "an aim of which all came is not sent again": (*_AIM, ("pump", 40), *_AGAIN),
    "an aim that a cut ended is sent again": (*_AIM, ("pump", 5), *_AGAIN),
    "nothing is let go while a landing has no plan":
        (_HERE, ("pump", 40), _THERE, *_AWAY, _HERE, ("take",), ("hear", 40)),
    "an aim's segments wait for the plan that may keep them":
        (_THERE, ("pump", 40), *_AIM, *_AWAY, _HERE, ("take",), ("hear", 40)),
    "a reject crosses the next landing": (_HERE, ("flip", 1), *_AWAY, _HERE, ("take",), ("hear", 40)),
    "a reject crosses a landing elsewhere":
        (_HERE, ("flip", 1), *_AWAY, _THERE, ("take",), ("hear", 40)),
    "an inner set that came wrong":
        (("pump", 3), _INNER, ("take",), ("flip", 1), ("serve", 9), ("wait", 0.2), ("serve", 9)),
    "a hop back finds what was kept nearby":
        (("call", "land", [0, 0, 0], 3.5, None, None), ("pump", 40), _HERE, ("pump", 40),
         ("call", "land", [0, 0, 0], 3.5, None, None)),
    "half a segment goes on in the next plan":
        (_HERE, ("pump", 6), ("call", "land", [2, 0, 0], 2.5, None, None)),
    "a newer version": (_HERE, ("pump", 40), ("cut",), ("connect", True, 1), ("pump", 5), _HERE),
    "only the newest landing waits": (("pump", 5), _HERE, _THERE, _INNER),
    "a pick outlives a cut": (("call", "pick", [1, 2, 3], None), ("take",), *_AGAIN),
}  # fmt: skip
"""What chance seldom makes, by name; each with a cache of nothing and with one of everything."""


def named_scripts() -> Iterator[tuple[str, Script]]:
    """Return what somebody thought of."""
    for name, operations in NAMED.items():
        for cache_bytes, credit_bytes in ((0, 50), (0, 10_000), (10_000, 50)):
            options = {
                "cache_bytes": cache_bytes,
                "credit_bytes": credit_bytes,
                "release_factor": 1.5,
                "max_bytes": None,
                "max_triangles": None,
                "max_segments": None,
            }
            script = Script(options, {"max_held_segments": 1000}, (("connect", True, 0), *operations))
            yield f"{name}, {cache_bytes} {credit_bytes}", script


def named_histories() -> Iterator[dict[str, Any]]:
    """Play the named scripts."""
    for name, script in named_scripts():
        steps, world = play(script)
        check(script, steps, world)
        yield {"history": name, "options": script.options, "steps": steps}


def make_script(theme: str, seed: int) -> Script:
    """Return one script of a theme."""
    chance = Random(f"{theme} {seed}")
    options: dict[str, Any] = {
        "cache_bytes": chance.choice((0, 0, 100, 300, 10_000)),
        "credit_bytes": chance.choice((1, 20, 50, 50, 200, 10_000)),
        "release_factor": chance.choice((None, 1.0, 1.5)),
        "max_bytes": chance.choice((None, None, None, 150)),
        "max_triangles": chance.choice((None, None, None, 40)),
        "max_segments": chance.choice((None, None, None, 5)),
    }
    limits = {
        "max_held_segments": chance.choice((0, 1, 5, 1000, 1000)),
        "max_credit_bytes": chance.choice((30, 1 << 20)),
    }
    words = THEMES[theme].split()
    count = chance.randrange(4, 24)
    moves = (OPERATIONS[chance.choice(words)](chance) for _ in range(count))
    return Script(options, limits, (("connect", True, 0), *moves))


def words_of(step: Step) -> str:
    """What a step did, in words without numbers."""
    name = step["do"][0]
    out = " ".join(_name_of(text, Direction.CLIENT_TO_SERVER) for text in step.get("out", []))
    into = _name_of(step["do"][1], Direction.SERVER_TO_CLIENT) if name == "receive" else ""
    events = " ".join(sorted({_word(row) for row in step.get("events", [])}))
    changed = " ".join(key for key in ("refused", "violation", "held", "visible") if key in step)
    return f"{name} {into}>{out}>{events}>{changed}"


def _word(row: list[Any]) -> str:
    """An event's name; whether it is of a landing, or leaves something out."""
    return f"{row[0]}{'' if row[1] is not None else '-'}{'+' if row[-1] else ''}"


def _name_of(text: str, direction: Direction) -> str:
    data = base64.b64decode(text)
    try:
        if is_payload(data):
            frame = decode_frame(data)
            return "last" if isinstance(frame, PayloadFrame) and frame.last else "frame"
        message = decode(data, direction)
    except DecodeError:
        return "nonsense"
    return "unknown" if isinstance(message, Unknown) else message.TYPE


def triples(world: World) -> set[tuple[str, ...]]:
    """What a history shows."""
    words = [words_of(step) for step in world.told.steps]
    situations = world.client.situations
    return set(zip(words, words[1:], words[2:], situations, strict=False))


def check(script: Script, steps: list[Step], world: World) -> None:
    """Raise AssertionError where a history is not what the protocol promises."""
    landed: dict[int, int] = {}
    for step in steps:
        for row in step.get("events", []):
            if row[0] in ("ready", "superseded"):
                landed[row[1]] = landed.get(row[1], 0) + 1
    assert all(count == 1 for count in landed.values()), f"an end that came twice: {script}"
    session = world.told.session
    if not any(name in {"again", "stray", "text"} for name, *_ in script.operations):
        assert session.repeated_bytes == 0, f"bytes that came twice: {script}"
        assert "violation" not in str(steps), f"a violation between the two: {script}"
    if world.server is not None and world.closed is None:
        assert session.unfinished is None, f"a landing without end: {script}"
    # Where a server takes no offer, what is shown is held no more, and shown until the next landing.
    if script.limits["max_held_segments"] > 0:
        absent = [segment for segment in session.visible if segment not in session.holdings]
        assert not absent, f"shown, and not held: {script}"


def shrink(script: Script, target: tuple[str, ...]) -> Script:
    """Leave out what a script need not have to show a triple."""
    size = max(1, len(script.operations) // 2)
    while size:
        at = len(script.operations) - size
        while at >= 0:
            rest = script.operations[:at] + script.operations[at + size :]
            shorter = Script(script.options, script.limits, rest)
            if target in triples(play(shorter)[1]):
                script = shorter
            at -= size
        size //= 2
    return script


def histories(theme: str, seen: set[tuple[str, ...]]) -> Iterator[dict[str, Any]]:
    """Make the histories of a theme; `seen` are the triples that others show already."""
    kept = seed = 0
    while kept < KEPT:
        script = make_script(theme, seed)
        seed += 1
        steps, world = play(script)
        check(script, steps, world)
        new = triples(world) - seen
        if not new:
            continue
        script = shrink(script, Random(seed).choice(sorted(new)))
        steps, world = play(script)
        check(script, steps, world)
        if len(steps) > MOST_STEPS:
            continue
        seen |= triples(world)
        kept += 1
        yield {"history": f"{theme} {seed - 1}", "options": script.options, "steps": steps}


def text_of(rows: Iterator[dict[str, Any]]) -> str:
    """Return a file: its messages, each once; then a line for each history, and one for each step."""
    numbers: dict[str, int] = {}

    def number(text: str) -> int:
        return numbers.setdefault(text, len(numbers))

    lines: list[dict[str, Any]] = []
    for row in rows:
        lines.append({"history": row["history"], "options": row["options"]})
        for step in row["steps"]:
            told = {key: value for key, value in step.items() if key != "do"}
            do = step["do"]
            if do[0] == "receive":
                do = ["receive", number(do[1])]
            if "out" in told:
                told["out"] = [number(text) for text in told["out"]]
            lines.append({"do": do, "told": told})
    return "".join(
        json.dumps(line, separators=(",", ":")) + "\n"
        for line in [{"messages": list(numbers)}, *lines]
    )


def corpus_files(themes: Iterable[str] = THEMES) -> dict[str, str]:
    """Return name -> text of every file; of the first themes alone where these are given."""
    seen: set[tuple[str, ...]] = set()
    files = {f"{theme}.jsonl": text_of(histories(theme, seen)) for theme in themes}
    return files | {"named.jsonl": text_of(named_histories())}


def main() -> int:
    """Write or check; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare, and write nothing")
    parser.add_argument("--seeds", type=int, help="play so many scripts of each theme, and check")
    arguments = parser.parse_args()
    if arguments.seeds is not None:
        for theme in THEMES:
            for seed in range(arguments.seeds):
                script = make_script(theme, seed)
                check(script, *play(script))
        return 0
    changed = 0
    for name, text in corpus_files().items():
        path = CORPUS / name
        if path.is_file() and path.read_text() == text:
            continue
        changed += 1
        if arguments.check:
            sys.stderr.write(f"error: {path} is not what session_generate.py writes\n")
        else:
            path.write_text(text)
            count = text.count('{"history"')
            sys.stdout.write(f"{name}: {count} histories, {len(text)} bytes\n")
    return int(arguments.check and changed > 0)


if __name__ == "__main__":
    sys.exit(main())
