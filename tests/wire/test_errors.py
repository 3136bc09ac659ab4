"""Errors: the tree, the tables, the texts."""

from __future__ import annotations

import pytest

from terraport_wire import (
    CLOSE_CODES,
    HTTP_STATUS,
    CloseCode,
    DecodeError,
    ErrorCode,
    FieldError,
    InvalidMessageError,
    MalformedError,
    TooLargeError,
    WireError,
)


def test_every_error_code_has_a_close_code_and_every_close_code_a_status() -> None:
    assert set(CLOSE_CODES) == set(ErrorCode)
    assert set(HTTP_STATUS) == set(CloseCode)
    for close, status in HTTP_STATUS.items():
        if close is not CloseCode.NORMAL:
            assert status == close - 4000


def test_every_error_is_a_wire_error() -> None:
    for error in (DecodeError, FieldError, InvalidMessageError, MalformedError, TooLargeError):
        assert issubclass(error, WireError)


@pytest.mark.parametrize("name", ["prefetch", "land", "pick"])
def test_refused_requests_leave_the_session_open(name: str) -> None:
    assert not FieldError(name, "radius_m", "got 0, expected more").fatal


@pytest.mark.parametrize("name", ["hello", "credit", "plan"])
def test_other_refused_messages_end_the_session(name: str) -> None:
    error = FieldError(name, "x", "got 0, expected more")
    assert error.fatal
    assert error.close_code == CloseCode.MALFORMED


def test_texts() -> None:
    assert str(MalformedError("got 1, expected 2", offset=5)) == "got 1, expected 2 (at byte 5)"
    assert (
        str(FieldError("pick", "origin", "got 1, expected 3")) == "pick.origin: got 1, expected 3"
    )
    assert TooLargeError("x").close_code == 4413
