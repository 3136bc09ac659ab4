"""Structured logging: each line is an event with fields, as text or JSON.

The message of a record is the event's name; ``extra={"fields": {...}}`` has its fields. Text lines
have the form ``TIME LEVEL event key=value ...``; with JSON each line is one object.
"""

from __future__ import annotations

import asyncio
import datetime as dt
import json
import logging
import sys
from typing import Any, Final

from terraport_server.session.rate_limit import RateLimit

__all__ = [
    "LINES_PER_S",
    "LOGGER",
    "LineBudget",
    "OncePerMinute",
    "SomePerMinute",
    "configure_logging",
    "log",
]

LOGGER = logging.getLogger("terraport.server")

LINES_PER_S: Final = 20.0
"""Maximum lines per second and level, averaged over 10 s: the log of a day stays below 0.5 GB."""

_MAX_REMEMBERED = 1024


def log(event: str, *, level: int = logging.INFO, **fields: object) -> None:
    """Log an event; fields that are ``None`` are omitted."""
    if LOGGER.isEnabledFor(level):
        shown = {name: value for name, value in fields.items() if value is not None}
        LOGGER.log(level, event, extra={"fields": shown})


def configure_logging(level: str, form: str, *, worker: int | None = None) -> None:
    """Write the records of the service and uvicorn to standard error.

    Parameters
    ----------
    level
        "debug", "info", "warning" or "error".
    form
        "text" or "json".
    worker
        Number of this process among several; a field of every line.
    """
    handler = logging.StreamHandler(sys.stderr)
    if worker is not None:
        handler.addFilter(lambda record: _add_worker(record, worker))
    handler.setFormatter(_JsonFormatter() if form == "json" else _TextFormatter())
    if level != "debug":
        handler.addFilter(LineBudget())
    for name in ("terraport", "uvicorn"):
        logger = logging.getLogger(name)
        logger.handlers = [handler]
        logger.propagate = False
        logger.setLevel(level.upper())
    # Metrics count requests and handshakes; logging each would flood the log.
    logging.getLogger("uvicorn.access").disabled = True
    logging.getLogger("uvicorn.error").addFilter(_is_worth_logging)


class LineBudget(logging.Filter):
    """Filter that limits the rate of lines per level; the next line reports how many were dropped.

    Separate levels, because clients cause information and warnings, which must not hide errors.
    Frequent events have limits of their own; this one covers all others.
    """

    def __init__(self, per_s: float = LINES_PER_S) -> None:
        super().__init__()
        self._per_s = per_s
        self._limits: dict[int, RateLimit] = {}
        self._left_out: dict[int, int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the line is written."""
        level = record.levelno
        limit = self._limits.get(level)
        if limit is None:
            limit = self._limits[level] = RateLimit(self._per_s, now_s=record.created)
        if not limit.take(record.created):
            self._left_out[level] = self._left_out.get(level, 0) + 1
            return False
        left_out = self._left_out.pop(level, 0)
        if left_out:
            record.fields = {**_fields(record), "lines_left_out": left_out}
        return True


class SomePerMinute:
    """Limit on the number of events per minute.

    Examples
    --------
    >>> some = SomePerMinute(2)
    >>> [some.left_out(second) for second in (0.0, 1.0, 2.0, 3.0, 61.0)]
    [0, 0, None, None, 2]
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._ends_s = float("-inf")
        self._seen = 0
        self._left_out = 0

    def left_out(self, now_s: float) -> int | None:
        """Return the number of events dropped before this one; None if this one is dropped too."""
        if now_s >= self._ends_s:
            self._ends_s, self._seen = now_s + 60.0, 0
        self._seen += 1
        if self._seen > self._most:
            self._left_out += 1
            return None
        left_out, self._left_out = self._left_out, 0
        return left_out


class OncePerMinute:
    """Limit of one event per kind and minute.

    The number of remembered kinds is bounded; all are forgotten when it is reached.
    """

    def __init__(self) -> None:
        self._seen: dict[tuple[str, ...], float] = {}

    def first(self, kind: tuple[str, ...], now_s: float) -> bool:
        """Return whether this kind was not seen for a minute."""
        last = self._seen.get(kind)
        if last is not None and now_s - last < 60.0:
            return False
        if len(self._seen) >= _MAX_REMEMBERED:
            self._seen.clear()
        self._seen[kind] = now_s
        return True


class _TextFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        fields = " ".join(f"{name}={_shown(value)}" for name, value in _fields(record).items())
        line = f"{_time(record)} {record.levelname.lower():7} {record.getMessage()}"
        text = f"{line} {fields}".rstrip()
        return text if record.exc_info is None else f"{text}\n{self._trace(record)}"

    def _trace(self, record: logging.LogRecord) -> str:
        assert record.exc_info is not None
        return self.formatException(record.exc_info)


class _JsonFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        line: dict[str, Any] = {
            "time": _time(record),
            "level": record.levelname.lower(),
            "event": record.getMessage(),
            **_fields(record),
        }
        if record.exc_info is not None:
            line["trace"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


_UNAUTHENTICATED_EVENTS: Final = ("WebSocket", "Invalid HTTP request", "Unsupported upgrade")


def _is_worth_logging(record: logging.LogRecord) -> bool:
    """Drop uvicorn's lines that any client can cause, and traces of requests cancelled on exit.

    Metrics count refusals.
    """
    if record.exc_info and isinstance(record.exc_info[1], asyncio.CancelledError):
        return False
    return not any(words in str(record.msg) for words in _UNAUTHENTICATED_EVENTS)


def _add_worker(record: logging.LogRecord, worker: int) -> bool:
    record.fields = {"worker": worker, **_fields(record)}
    return True


def _fields(record: logging.LogRecord) -> dict[str, Any]:
    fields = getattr(record, "fields", {})
    return fields if isinstance(fields, dict) else {}


def _time(record: logging.LogRecord) -> str:
    moment = dt.datetime.fromtimestamp(record.created, tz=dt.UTC)
    return moment.isoformat(timespec="milliseconds")


def _shown(value: object) -> str:
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return json.dumps(text) if not text or any(c in text for c in ' "=\n\r\t') else text
