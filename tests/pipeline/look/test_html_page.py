"""What the HTML pages share."""

from __future__ import annotations

from pathlib import Path

import pytest
from jinja2 import UndefinedError

from terraport_pipeline.report.html_page import page_templates, replace_page


def drawn(text: str, **values: object) -> str:
    return page_templates("terraport_pipeline.report").from_string(text).render(**values)


def test_what_is_inserted_is_escaped() -> None:
    assert drawn("{{ name }}", name="<pit> & co") == "&lt;pit&gt; &amp; co"


def test_a_name_that_nobody_gave_is_refused() -> None:
    with pytest.raises(UndefinedError, match="missing"):
        drawn("{{ missing }}")


def test_filters() -> None:
    text = "{{ data | base64 }} {{ count | amount }} {{ size | bytes }}"
    assert drawn(text, data=b"\x00\xff", count=1234567.4, size=2_500_000) == "AP8= 1,234,567 2.5 MB"


def test_the_new_page_takes_the_old_ones_place(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text("old")
    assert replace_page(path, "Höhe\n") == len(path.read_bytes()) == 6
    assert path.read_bytes() == "Höhe\n".encode()
    assert list(tmp_path.iterdir()) == [path]


def test_a_page_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "page.html").mkdir()
    with pytest.raises(OSError):
        replace_page(tmp_path / "page.html", "new")
    assert [each.name for each in tmp_path.iterdir()] == ["page.html"]
