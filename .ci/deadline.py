"""A pytest plugin for ``.ci/run changed``: after its time no further test is begun, and it says so.

``TERRAPORT_CHANGED_UNTIL`` is the moment, in seconds since 1970.
"""

from __future__ import annotations

import os
import time

import pytest

REASON = "not reached in time; `.ci/run` runs it"


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Skip what would begin too late."""
    if time.time() > float(os.environ["TERRAPORT_CHANGED_UNTIL"]):
        pytest.skip(REASON)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how much was left."""
    left = [
        report.nodeid
        for report in terminalreporter.stats.get("skipped", [])
        if isinstance(report.longrepr, tuple) and REASON in report.longrepr[2]
    ]
    if left:
        files = {name.partition("::")[0] for name in left}
        terminalreporter.write_line(f"{len(left)} tests in {len(files)} files: {REASON}")
