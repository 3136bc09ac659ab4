"""Which connections are passed on: those whose URL names a group, as the session will read it."""

from __future__ import annotations

import pytest

from terraport_server.group_connection import group_named_by


@pytest.mark.parametrize(
    ("url", "group"),
    [
        (b"/scenes/pit/stream", None),
        (b"/scenes/pit/stream?group=tour-1", "tour-1"),
        (b"/scenes/pit/stream?a=b&group=tour&c", "tour"),
        # Written another way, and still the same group: it must come to the same worker.
        (b"/scenes/pit/stream?group=t%6Fur", "tour"),
        (b"/scenes/pit/stream?gr%6Fup=tour", "tour"),
        (b"/scenes/pit/stream?group=first&group=last", "last"),
        (b"/scenes/pit/stream?group=", None),
        (b"/scenes/pit/stream?group=a%20b", None),
        (b"/scenes/pit/stream?group=" + b"x" * 65, None),
        (b"/scenes/group/stream", None),
        (b"/scenes/pit/stream?group=\xff", None),
    ],
)
def test_the_group_that_a_url_names(url: bytes, group: str | None) -> None:
    assert group_named_by(url) == group
