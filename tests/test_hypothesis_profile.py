"""One profile for every property test: none of them fails because the machine is busy."""

from __future__ import annotations

import re
from pathlib import Path

from hypothesis import HealthCheck, settings

TESTS = Path(__file__).parent
SAYS_IT_TWICE = re.compile(r"settings\([^)]*\b(?:deadline|suppress_health_check)=")


def test_the_clock_fails_no_property() -> None:
    assert settings().deadline is None
    assert HealthCheck.too_slow in settings().suppress_health_check


def test_the_profile_alone_says_so() -> None:
    files = [path for path in TESTS.rglob("*.py") if path != TESTS / "conftest.py"]
    assert [path for path in files if SAYS_IT_TWICE.search(path.read_text("utf-8"))] == []
