"""What the docs say of options is what the options dataclasses say."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

import pytest
import typer

from terraport.cli.lazy import VERBS
from terraport_pipeline.cli.from_options import options_of
from terraport_pipeline.workflow.build import BuildOptions

ROOT = Path(__file__).parents[3]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
OPTIONS = {field.flags[0]: field for _, field in options_of(BuildOptions)}
ABOUT_BUILDS = [
    ROOT / "docs" / page
    for page in (
        "how-to/build.md", "how-to/photos.md", "how-to/label-regions.md",
        "topics/reconstruction.md", "topics/segmentation.md", "topics/textures.md",
        "topics/tiled-build.md",
    )
]  # fmt: skip
OF_OTHER_PROGRAMS = {"--smoke"}
"""Of benchmarks that those pages name."""


def flags_of(*verbs: str) -> set[str]:
    """Every flag of some verbs of the command line, of the commands below them too."""
    app = typer.Typer(add_completion=False)
    app.callback()(lambda: None)
    for verb in VERBS:
        if verb.name in verbs:
            importlib.import_module(verb.module).register(app)
    waiting: list[Any] = [typer.main.get_command(app)]
    flags = {"--help"}
    while waiting:
        command = waiting.pop()
        waiting += getattr(command, "commands", {}).values()
        for parameter in command.params:
            flags |= {*parameter.opts, *parameter.secondary_opts}
    return flags


def build_rows() -> list[tuple[str, str]]:
    page = (ROOT / "docs/topics/limits.md").read_text(encoding="utf-8")
    section = page.split("\n## The build\n")[1].split("\n## ")[0]
    return re.findall(r"^\| `(--[a-z0-9-]+)` +\| (.*?) +\|", section, re.MULTILINE)


def test_the_page_of_limits_has_rows() -> None:
    assert len(build_rows()) >= 15


@pytest.mark.parametrize(("flag", "default"), build_rows(), ids=lambda text: text[:24])
def test_the_page_of_limits_has_the_defaults(flag: str, default: str) -> None:
    assert default.replace("`", "") == OPTIONS[flag].default_text


def test_commands_in_the_docs_take_the_options_they_are_shown_with() -> None:
    build_flags = flags_of("build")
    shown = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for command in re.findall(r"terraport build ([^\n`#|&]*)", text):
            flags = re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", command)
            assert set(flags) <= build_flags, f"{page.relative_to(ROOT)}: terraport build {command}"
            shown += flags
    assert len(set(shown)) >= 5


def test_the_pages_about_builds_name_options_that_there_are() -> None:
    all_flags = flags_of(*(verb.name for verb in VERBS)) | OF_OTHER_PROGRAMS
    for page in ABOUT_BUILDS:
        text = page.read_text(encoding="utf-8")
        named = {
            flag
            for span in re.findall(r"`[^`\n]+`", text)
            if not re.search(r"pip |dask|python |\.py", span)
            for flag in re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", span)
        }
        assert named <= all_flags, f"{page.relative_to(ROOT)}: {named - all_flags}"
