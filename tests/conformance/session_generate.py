"""Write the session corpus: ``python tests/conformance/session_generate.py [--check]``.

Scripts are made by chance (fixed seeds) for each of the themes below and played
(``session_play.py``). What one shows is a set of triples: what three steps in a row did, told in
words, and in what situation the client was after the first. A script that shows a triple which no
script before it showed is shrunk, by leaving operations out for as long as it still shows it, and
kept: a history is short, and each is there for something. What :func:`check` says must be true of
every one, kept or not. What chance seldom makes stands in ``named.jsonl``.

The files are the same on every run. ``--check`` compares them and writes nothing. ``--seeds N``
plays N scripts of each theme and checks them alone: to look for faults.
"""

from __future__ import annotations

import argparse
import base64
import json
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any, Final

if __name__ == "__main__":  # run as a script: the package "conformance" lies in tests/
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from conformance.session_play import Script, World, play
from conformance.session_scripts import THEMES, make_script, named_scripts
from conformance.session_steps import Step

from terraport_wire import (
    DecodeError,
    Direction,
    PayloadFrame,
    Unknown,
    decode,
    decode_frame,
    is_payload,
)

CORPUS: Final = Path(__file__).resolve().parent / "session"
KEPT: Final = 100
"""Histories of a theme."""
MOST_STEPS: Final = 50
"""Of a history that is kept."""
ALONE: Final = frozenset({"groups", "levels"})
"""Themes whose histories are chosen without a look at the others."""


def named_histories() -> Iterator[dict[str, Any]]:
    """Play the named scripts."""
    for name, script in named_scripts():
        steps, world = play(script)
        check(script, steps, world)
        yield {"history": name, "options": script.options, "steps": steps}


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
    # Where a server takes no offer, what is shown is not held, and is shown until the next landing.
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
            shorter = replace(script, operations=rest)
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
    """Return a file: its messages, each once; then lines of each history, and of each step."""
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
    """Return name -> text of every file; of these themes alone where they are given."""
    seen: set[tuple[str, ...]] = set()
    # What groups and levels show is theirs alone: a rule of theirs that changes leaves the other
    # files be.
    files = {
        f"{theme}.jsonl": text_of(histories(theme, set() if theme in ALONE else seen))
        for theme in themes
    }
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
