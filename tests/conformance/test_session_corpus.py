"""The Python client runs the session corpus, and the generator writes what is there."""

from __future__ import annotations

import copy

import pytest
from conformance.session_generate import CORPUS, corpus_files
from conformance.session_scripts import THEMES
from conformance.session_steps import difference, read_histories

FILES = sorted(CORPUS.glob("*.jsonl"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_history(path) -> None:
    histories = read_histories(path)
    assert len(histories) >= 30
    for history in histories:
        assert difference(history) is None, history["history"]


def test_there_are_five_hundred_histories_of_every_theme_in_few_bytes() -> None:
    assert {path.stem for path in FILES} == {*THEMES, "named"}
    assert sum(len(read_histories(path)) for path in FILES) >= 500
    assert sum(path.stat().st_size for path in FILES) < 2_300_000


def test_a_wrong_expectation_is_noticed() -> None:
    """Each thing that a step tells is compared."""
    histories = read_histories(CORPUS / "strays.jsonl")
    for wrong in ("out", "events", "visible", "held", "unfinished", "violation"):
        changed = copy.deepcopy(next(row for row in histories if f"'{wrong}'" in str(row)))
        step = next(step for step in changed["steps"] if wrong in step)
        step[wrong] = ["?"]
        assert difference(changed) is not None


def test_the_generator_writes_what_is_named() -> None:
    """The same on every run; what chance makes: the next test, ``session_generate.py --check``."""
    for name, text in corpus_files([]).items():
        assert (CORPUS / name).read_text() == text


@pytest.mark.thorough
def test_the_generator_writes_every_theme() -> None:
    for name, text in corpus_files().items():
        assert (CORPUS / name).read_text() == text, name
