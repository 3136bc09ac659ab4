"""A pytest plugin: of the tests that were selected, run every n-th (``--share n``).

Where it begins depends on the commit, so that each is run by some commit.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--share``."""
    parser.addoption("--share", type=int, default=1, metavar="N", help="run every N-th test")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the others out, and say so as pytest does."""
    share = config.getoption("--share")
    command = ["git", "rev-parse", "HEAD"]
    root = Path(__file__).resolve().parents[1]
    commit = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False).stdout
    # With fewer tests than shares some would be empty, and pytest fails where nothing is left.
    first = int(commit[:8] or "0", 16) % max(min(share, len(items)), 1)
    chosen = items[first::share]
    config.hook.pytest_deselected(items=[item for item in items if item not in chosen])
    items[:] = chosen
