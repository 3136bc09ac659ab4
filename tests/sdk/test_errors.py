"""What errors say."""

from __future__ import annotations

import pytest

from terraport import errors


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (
            errors.MissingExtraError("--png", "terraport[pipeline]"),
            '--png needs packages that are not installed: pip install "terraport[pipeline]"',
        ),
        (errors.SessionClosedError("gone"), "the session is closed: gone"),
        (
            errors.ConnectionFailedError("ws://h", 1, "refused"),
            "no connection to ws://h after 1 attempt: refused",
        ),
        (
            errors.ConnectionFailedError("ws://h", 3, "refused"),
            "no connection to ws://h after 3 attempts: refused",
        ),
        (errors.ServerError("forbidden", "no"), "the server answered forbidden: no"),
        (errors.ProtocolViolationError("gap"), "the server broke the protocol: gap"),
        (errors.HttpError("http://h", 404, "no"), "http://h answered 404: no"),
        (errors.HttpError("http://h", 0, "refused"), "http://h did not answer: refused"),
        (errors.LandingSupersededError(1, 2), "landing 1 was superseded by landing 2"),
        (errors.LandingTimeoutError(1, 5.0, 0, 0), "landing 1 got no plan within 5 s"),
        (errors.LandingTimeoutError(1, 5.0, 2, 9), "landing 1 has 2 of 9 segments after 5 s"),
        (
            errors.LandingIncompleteError(1, tuple(range(10))),
            (
                "landing 1 is ready but for 10 segment(s) that could not be delivered whole: "
                "0, 1, 2, 3, 4, 5, 6, 7 and 2 more"
            ),
        ),
    ],
)
def test_texts(error: errors.TerraportError, text: str) -> None:
    assert str(error) == text
    assert isinstance(error, errors.TerraportError)


def test_builtin_kin() -> None:
    """Callers who know only Python's own errors catch these too."""
    assert issubclass(errors.UsageError, ValueError)
    assert issubclass(errors.MissingExtraError, ImportError)
    assert issubclass(errors.LandingTimeoutError, TimeoutError)
    assert errors.LandingSuperseded is errors.LandingSupersededError
