"""Both cores run the repository's corpora, good cases and bad, and decline nothing unsaid."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from conformance.generate import CORPUS
from engines.programs import Client

SESSIONS = CORPUS.parent / "session"
PAYLOADS = Path(__file__).resolve().parents[1] / "conformance" / "scene" / "payload"

DECLINED: dict[str, list[str]] = {"cpp": []}
"""By language; also in docs/topics/clients.md."""


@pytest.mark.parametrize("kind", ["wire", "payload"])
def test_the_whole_corpus_passes(client: Client, kind: str) -> None:
    folder = CORPUS if kind == "wire" else PAYLOADS
    files = [path for path in folder.rglob("*") if path.is_file() and path.suffix != ".json"]
    done = client.corpus(kind, folder)
    assert done.failed == 0, done.output[-4000:]
    assert done.declined == DECLINED[client.language]
    assert done.passed + len(done.declined) == len(files)


def count_histories(path: Path) -> int:
    """Histories of one file of the session corpus."""
    return path.read_text().count('\n{"history":')


def test_the_whole_session_corpus_passes(client: Client) -> None:
    """Every history, step by step, as the Python client of protocol 1 did it."""
    done = client.corpus("session", SESSIONS)
    assert done.failed == 0, done.output[-4000:]
    assert done.declined == []
    assert done.passed == sum(count_histories(path) for path in SESSIONS.glob("*.jsonl"))


@pytest.mark.parametrize("key", ["out", "events", "visible", "held", "unfinished", "violation"])
def test_another_session_is_noticed(client: Client, key: str, tmp_path: Path) -> None:
    """Each thing that a step tells is compared."""
    lines = (SESSIONS / "strays.jsonl").read_text().splitlines()
    number = next(number for number, line in enumerate(lines) if f'"{key}":' in line)
    row = json.loads(lines[number])
    row["told"][key] = None if row["told"][key] is True else [[99]]
    lines[number] = json.dumps(row, separators=(",", ":"))
    (tmp_path / "strays.jsonl").write_text("\n".join(lines) + "\n")
    done = client.corpus("session", tmp_path)
    assert done.failed == 1, done.output[-2000:]
    assert done.passed == count_histories(SESSIONS / "strays.jsonl") - 1


@pytest.mark.parametrize("kind", ["wire", "payload"])
def test_a_wrong_expectation_is_noticed(client: Client, kind: str, tmp_path: Path) -> None:
    """The runner compares: a corpus that expects something else fails."""
    if kind == "wire":
        for folder in ("good", "bad"):
            (tmp_path / folder).mkdir()
        for suffix in (".bin", ".json"):
            data = (CORPUS / "good" / f"message-land-full{suffix}").read_bytes()
            data = data.replace(b'"radius_m": ', b'"radius_m": 1')
            (tmp_path / "good" / f"land{suffix}").write_bytes(data)
    else:
        for suffix in ("", ".json"):
            data = (PAYLOADS / f"good-full.glb{suffix}").read_bytes()
            data = data.replace(b'"region_ids":[', b'"region_ids":[1')
            (tmp_path / f"good-full.glb{suffix}").write_bytes(data)
    done = client.corpus(kind, tmp_path)
    assert (done.passed, done.failed) == (0, 1)
