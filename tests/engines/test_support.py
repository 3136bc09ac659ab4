"""The support matrix in the docs says what the tests show."""

from __future__ import annotations

import pytest
from engines import support


def test_every_claim_has_its_test() -> None:
    assert support.missing_tests() == []


def test_the_page_is_what_the_claims_say() -> None:
    written = support.PAGE.read_text(encoding="utf-8")
    assert support.page_text() == written, "python tests/engines/support.py writes it"


def test_a_claim_without_its_test_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    yes = support.Yes("tests/engines/test_support.py", "test_that_is_not_there")
    monkeypatch.setattr(support, "FEATURES", {"flying": (yes, *[support.No("no wings")] * 3)})
    assert len(support.missing_tests()) == 1
