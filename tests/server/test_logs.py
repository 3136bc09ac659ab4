"""Log lines."""

from __future__ import annotations

import json
import logging

import pytest

from terraport_server.logs import LOGGER, OncePerMinute, configure_logging, log


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


def test_once_per_minute_and_bounded() -> None:
    once = OncePerMinute()
    assert [once.first(("a",), s) for s in (0.0, 59.0, 60.0, 61.0)] == [True, False, True, False]
    for number in range(5000):
        assert once.first((str(number),), 0.0)
    assert len(once._seen) <= 1024
