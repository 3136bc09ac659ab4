"""The Python client runs the landings corpus, and what the generator makes."""

from __future__ import annotations

import copy

import pytest
from conformance.landings_generate import THEMES, history
from conformance.landings_steps import CORPUS, difference, read_histories


@pytest.mark.parametrize("theme", THEMES)
def test_every_history(theme: str) -> None:
    histories = read_histories(CORPUS / f"{theme}.jsonl")
    assert len(histories) >= 25
    for each in histories:
        assert difference(each) is None, each["history"]
    # Not compared with what is there: DEFLATE has many right answers.
    assert difference(history(theme, 3)) is None


def test_a_wrong_expectation_is_noticed() -> None:
    """Each thing that a step tells is compared."""
    histories = read_histories(CORPUS / "landings.jsonl")
    for wrong in ("shown", "hidden", "sent", "inner"):
        changed = copy.deepcopy(next(each for each in histories if f"'{wrong}'" in str(each)))
        told = next(step[-1] for step in changed["steps"] if wrong in step[-1])
        told[wrong] = ["?"]
        assert difference(changed) is not None
