"""Python's runner of the wire corpus, and the check that the corpus is what generate.py writes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from conformance.cases import observe
from conformance.generate import CORPUS, corpus_files, differences

from terraport_wire.messages import MESSAGES

GOOD = sorted((CORPUS / "good").glob("*.json"))
BAD = sorted((CORPUS / "bad").glob("*.json"))


def test_the_corpus_is_what_the_script_writes() -> None:
    assert differences(corpus_files()) == []


def test_every_message_type_is_in_the_corpus_both_ways() -> None:
    for files, suffix in ((GOOD, "minimal"), (GOOD, "full"), (BAD, "truncated_middle")):
        names = {path.stem for path in files}
        for messages in MESSAGES.values():
            for type_name in messages:
                assert f"message-{type_name}-{suffix}" in names


@pytest.mark.parametrize("path", GOOD, ids=lambda path: path.stem)
def test_good(path: Path) -> None:
    facts = json.loads(path.read_bytes())
    observed = observe(path.with_suffix(".bin").read_bytes(), facts)
    expected = {key: facts[key] for key in ("message", "unknown", "frame") if key in facts}
    if facts.get("canonical"):
        expected["canonical"] = True
    assert observed == expected


@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_bad(path: Path) -> None:
    facts = json.loads(path.read_bytes())
    observed = observe(path.with_suffix(".bin").read_bytes(), facts)
    assert observed == {"error": facts["error"]}
