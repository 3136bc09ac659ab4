"""Tokens and origins."""

from __future__ import annotations

from pathlib import Path

import pytest

from terraport_server.auth.gate import Gate, bearer_token
from terraport_server.auth.origins import origin_is_allowed
from terraport_server.auth.tokens import StaticToken, read_tokens
from terraport_server.errors import SettingsError
from terraport_server.settings import Settings
from terraport_wire import ErrorCode

GATE = Gate(
    [
        StaticToken("all", "opens-everything"),
        StaticToken("one", "opens-only-the-pit", frozenset({"pit"})),
    ]
)


@pytest.mark.parametrize(
    ("token", "scene", "expected"),
    [
        ("opens-everything", "pit", None),
        ("opens-everything", "other", None),
        ("opens-only-the-pit", "pit", None),
        ("opens-only-the-pit", "other", ErrorCode.FORBIDDEN),
        ("opens-nothing-at-all", "pit", ErrorCode.UNAUTHORISED),
        ("", "pit", ErrorCode.UNAUTHORISED),
        ("opens-everythin", "pit", ErrorCode.UNAUTHORISED),
        ("\udc80 no utf-8", "pit", ErrorCode.UNAUTHORISED),
        (None, "pit", ErrorCode.UNAUTHORISED),
    ],
)
def test_gate(token: str | None, scene: str, expected: ErrorCode | None) -> None:
    assert GATE.check(token, scene) is expected


def test_a_token_of_metrics_opens_no_scene_and_moves_no_group() -> None:
    gate = Gate([StaticToken("ops", "reads-the-metrics", scopes=frozenset({"metrics"}))])
    assert gate.check("reads-the-metrics", "pit") is ErrorCode.FORBIDDEN
    bearer = gate.find("reads-the-metrics")
    assert bearer is not None
    assert not bearer.guide
    assert gate.withdrawal(bearer, "pit") == "revoked"


def test_an_open_gate_asks_for_nothing() -> None:
    gate = Gate(None)
    assert gate.is_open
    assert gate.check(None, "pit") is None
    assert gate.check("anything", "pit") is None


def test_tokens_are_not_kept_in_the_clear() -> None:
    assert "opens-everything" not in repr(vars(GATE))


def test_from_settings(tmp_path: Path) -> None:
    path = tmp_path / "tokens"
    path.write_text("a token-of-somebody-else pit\n")
    gate = Gate.from_settings(Settings(token="sixteen-characters", tokens_file=path))  # type: ignore[arg-type]
    assert gate.check("sixteen-characters", "any") is None
    assert gate.check("token-of-somebody-else", "pit") is None
    assert Gate.from_settings(Settings()).is_open


def test_a_short_token_is_refused_without_showing_it() -> None:
    with pytest.raises(SettingsError, match="got a token of 5 characters, expected 16") as caught:
        Gate.from_settings(Settings(token="secre"))  # type: ignore[arg-type]
    assert "secre," not in str(caught.value)


def test_tokens_file(tmp_path: Path) -> None:
    path = tmp_path / "tokens"
    path.write_text(
        "# who\n\nanna   aaaaaaaaaaaaaaaa\nbob bbbbbbbbbbbbbbbb pit quarry\n"
        "kim cccccccccccccccc +guide\nlea dddddddddddddddd +guide pit\n"
        "ops eeeeeeeeeeeeeeee +metrics\nmax ffffffffffffffff +land +metrics pit\n"
    )
    assert read_tokens(path) == [
        StaticToken("anna", "aaaaaaaaaaaaaaaa"),
        StaticToken("bob", "bbbbbbbbbbbbbbbb", frozenset({"pit", "quarry"})),
        StaticToken("kim", "cccccccccccccccc", None, frozenset({"land", "guide"})),
        StaticToken("lea", "dddddddddddddddd", frozenset({"pit"}), frozenset({"land", "guide"})),
        StaticToken("ops", "eeeeeeeeeeeeeeee", None, frozenset({"metrics"})),
        StaticToken("max", "ffffffffffffffff", frozenset({"pit"}), frozenset({"land", "metrics"})),
    ]


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "holds no token"),
        (b"# only a comment\n", "holds no token"),
        (b"lonely\n", "line 1: got one word"),
        (b"ok aaaaaaaaaaaaaaaa\nbob short\n", "line 2.*5 characters"),
        (b"ok aaaaaaaaaaaaaaaa +gude pit\n", r"line 1: got \+gude, expected scopes out of \+land"),
        (b"\xff\xfe\n", "not UTF-8"),
        (b"a" * (1 << 20) + b"b", "larger than"),
    ],
)
def test_bad_tokens_files(tmp_path: Path, content: bytes, text: str) -> None:
    path = tmp_path / "tokens"
    path.write_bytes(content)
    with pytest.raises(SettingsError, match=text):
        read_tokens(path)
    with pytest.raises(SettingsError, match="No such file"):
        read_tokens(tmp_path / "missing")


@pytest.mark.parametrize(
    ("header", "token"),
    [
        (None, None),
        ("Bearer abc", "abc"),
        ("bearer abc", "abc"),
        ("Bearer", ""),
        ("Basic abc", ""),
        ("", ""),
    ],
)
def test_bearer_token(header: str | None, token: str | None) -> None:
    assert bearer_token(header) == token


@pytest.mark.parametrize(
    ("origin", "host", "allowed", "expected"),
    [
        (None, "a:1", (), True),
        ("http://a:1", "a:1", (), True),
        ("https://A:1", "a:1", (), True),
        ("http://a:2", "a:1", (), False),
        ("http://evil", "a:1", (), False),
        ("null", "a:1", (), False),
        ("http://evil", None, (), False),
        ("http://[evil", "a:1", (), False),
        ("https://viewer", "a:1", ("https://viewer",), True),
        ("https://viewer.evil", "a:1", ("https://viewer",), False),
        ("http://evil", "a:1", ("*",), True),
    ],
)
def test_origins(
    origin: str | None, host: str | None, allowed: tuple[str, ...], expected: bool
) -> None:
    assert origin_is_allowed(origin, host, allowed) is expected
