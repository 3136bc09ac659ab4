"""Examples and documentation run as they stand, against the real service."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import pytest

from terraport_server import BackgroundServer

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "client_sdk" / "python" / "examples"
PAGES = (ROOT / "docs/how-to/python-sdk.md", ROOT / "client_sdk/python/README.md")

WORDS = {
    "land_and_measure.py": (("30", "1", "30"), "36 segments, "),
    "walk.py": ((), "hop 4: "),
    "export_glb.py": (("30", "1", "30", "here.glb"), "here.glb: "),
}
"""Arguments behind the URL, and what the output must hold, by script."""


def test_every_example_is_run() -> None:
    assert sorted(WORDS) == sorted(path.name for path in EXAMPLES.glob("*.py"))


@pytest.mark.parametrize("name", sorted(WORDS))
def test_example(
    name: str,
    server: BackgroundServer,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments, expected = WORDS[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, server.scene_url("grid"), *arguments])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    assert expected in capsys.readouterr().out


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_page(
    page: Path,
    server: BackgroundServer,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Every Python block of the page, one after the other, in one namespace."""
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
    assert blocks
    monkeypatch.chdir(tmp_path)
    namespace = {"url": server.scene_url("grid"), "__name__": "page"}
    for number, block in enumerate(blocks):
        exec(compile(block, f"{page.name} block {number}", "exec"), namespace)
        assert capsys.readouterr().out or list(tmp_path.iterdir())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)", page.read_text()):
        if "://" not in target:
            assert (page.parent / target).exists(), target
