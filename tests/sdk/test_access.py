"""Tokens that may be replaced."""

from __future__ import annotations

from terraport.access import Access


def test_a_fixed_token_is_never_newer() -> None:
    access = Access("one")
    assert access.headers() == {"Authorization": "Bearer one"}
    assert not access.has_newer()
    assert Access(None).headers() == {}
    assert not Access(None).has_newer()


def test_what_gives_tokens_is_asked_each_time() -> None:
    tokens = ["one"]
    access = Access(lambda: tokens[-1])
    assert access.headers() == {"Authorization": "Bearer one"}
    assert not access.has_newer()
    tokens.append("two")
    assert access.has_newer()
    assert access.headers() == {"Authorization": "Bearer two"}
    assert not access.has_newer()


def test_a_token_is_not_shown() -> None:
    assert "one" not in repr(Access("one"))
