"""Scene URLs in every form, and tokens that may be replaced."""

from __future__ import annotations

import pytest

from terraport.address import Access, SceneUrl
from terraport.errors import UsageError


@pytest.mark.parametrize(
    ("text", "server", "scene"),
    [
        ("http://h:8080/scenes/pit", "http://h:8080", "pit"),
        ("ws://h:8080/scenes/pit/stream", "http://h:8080", "pit"),
        ("wss://h/tp/scenes/pit/", "https://h/tp", "pit"),
        ("https://h/", "https://h", None),
        ("http://h/prefix", "http://h/prefix", None),
        ("http://h/prefix/scenes", "http://h/prefix", None),
        ("http://[::1]:80/scenes/a%2Fb", "http://[::1]:80", "a/b"),
    ],
)
def test_every_form_is_read(text: str, server: str, scene: str | None) -> None:
    assert SceneUrl.parse(text) == SceneUrl(server, scene)


def test_addresses_are_quoted_and_keys_differ() -> None:
    url = SceneUrl("https://h", "a b/c")
    assert url.http == "https://h/scenes/a%20b%2Fc"
    assert url.stream == "wss://h/scenes/a%20b%2Fc/stream"
    assert len(url.key) == 16
    assert url.key != url.with_scene("other").key


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("quarry", "expected http"),
        ("localhost:8080/scenes/pit", r"; perhaps http://localhost:8080/scenes/pit$"),
        ("user:secret@h/scenes/pit", r"\(or ws, wss\)$"),
        ("ftp://h/scenes/pit", "expected http"),
        ("http:///scenes/pit", "expected http"),
        ("http://h:99999/scenes/pit", "[Pp]ort"),
        ("http://h/scenes/pit/segments/3.glb", "expected \\[/prefix\\]/scenes/ID"),
        ("http://user:secret@h/scenes/pit", "credentials"),
        ("http://h/scenes/pit?token=secret", "token="),
    ],
)
def test_other_urls_are_refused_without_repeating_secrets(text: str, reason: str) -> None:
    with pytest.raises(UsageError, match=reason) as caught:
        SceneUrl.parse(text)
    assert "secret" not in str(caught.value)


def test_a_server_url_names_no_scene() -> None:
    with pytest.raises(UsageError, match="names no scene"):
        _ = SceneUrl.parse("http://h").stream


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
