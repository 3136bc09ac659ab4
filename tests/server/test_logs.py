"""Log lines."""

from __future__ import annotations

import asyncio
import json
import logging

import pytest

from terraport_server.logging import (
    LINES_PER_S,
    LOGGER,
    OncePerMinute,
    SomePerMinute,
    configure_logging,
    log,
)


@pytest.fixture
def logging_as_it_was() -> object:
    names = ("terraport", "uvicorn")
    before = {
        name: (logging.getLogger(name).handlers, logging.getLogger(name).propagate)
        for name in names
    }
    yield
    for name, (handlers, propagate) in before.items():
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = handlers, propagate
        logger.setLevel(logging.NOTSET)


@pytest.mark.usefixtures("logging_as_it_was")
def test_text_is_one_line_with_quoted_fields(capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging("info", "text")
    log("landing ready", landing="ab-3", seconds=0.123456, reason='two\nlines "here"', none=None)
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    shown = 'info    landing ready landing=ab-3 seconds=0.1235 reason="two\\nlines \\"here\\""\n'
    assert line.endswith(shown)


@pytest.mark.usefixtures("logging_as_it_was")
def test_json_is_one_object_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging("info", "json")
    log("refused", level=logging.WARNING, code="malformed", client="::1")
    line = json.loads(capsys.readouterr().err)
    assert line["event"] == "refused"
    assert (line["level"], line["code"], line["client"]) == ("warning", "malformed", "::1")
    assert line["time"].endswith("+00:00")


@pytest.mark.usefixtures("logging_as_it_was")
def test_the_level_counts(capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging("warning", "text")
    log("quiet")
    assert capsys.readouterr().err == ""
    assert not LOGGER.isEnabledFor(logging.INFO)


@pytest.mark.usefixtures("logging_as_it_was")
def test_requests_that_are_cut_off_leave_no_traces(capsys: pytest.CaptureFixture[str]) -> None:
    """A service that was stopped with 80 requests under way wrote 280 KB."""
    configure_logging("info", "text")
    uvicorn = logging.getLogger("uvicorn.error")
    for fault in (asyncio.CancelledError("Task cancelled"), ValueError("of our own")):
        try:
            raise fault
        except (asyncio.CancelledError, ValueError) as error:
            uvicorn.error("Exception in ASGI application", exc_info=error)
    lines = capsys.readouterr().err
    assert lines.count("Exception in ASGI application") == 1
    assert "of our own" in lines


def test_once_per_minute_and_bounded() -> None:
    once = OncePerMinute()
    assert [once.first(("a",), s) for s in (0.0, 59.0, 60.0, 61.0)] == [True, False, True, False]
    for number in range(5000):
        assert once.first((str(number),), 0.0)
    assert len(once._seen) <= 1024


@pytest.mark.usefixtures("logging_as_it_was")
def test_lines_are_bounded_by_level(capsys: pytest.CaptureFixture[str]) -> None:
    """What clients make happen does not hide an error, and what is left out is said."""
    configure_logging("info", "json")
    for number in range(5000):
        log("landing ready", number=number)
    log("disk failed", level=logging.ERROR)
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert 10 * LINES_PER_S <= len(lines) - 1 < 2000  # as long as it took it may go on
    assert lines[-1]["event"] == "disk failed"
    handler = logging.getLogger("terraport").handlers[0]
    (budget,) = handler.filters
    later = logging.makeLogRecord({"levelno": logging.INFO, "created": 4e9, "msg": "later"})
    assert budget.filter(later)  # type: ignore[union-attr]
    left_out = [line.get("lines_left_out", 0) for line in lines] + [later.fields["lines_left_out"]]  # type: ignore[attr-defined]
    assert sum(left_out) == 5001 - len(lines)


@pytest.mark.usefixtures("logging_as_it_was")
def test_debug_has_all_lines(capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging("debug", "text")
    for _ in range(1000):
        log("landing ready")
    assert capsys.readouterr().err.count("landing ready") == 1000


def test_some_per_minute() -> None:
    some = SomePerMinute(3)
    assert [some.left_out(s) for s in (0.0, 1.0, 2.0, 3.0, 59.0)] == [0, 0, 0, None, None]
    assert [some.left_out(s) for s in (60.0, 61.0)] == [2, 0]
