from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import pytest
import typer
from typer.testing import CliRunner

from terraport_pipeline.cli.build import register
from terraport_pipeline.cli.from_options import command_of, options_of
from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import COMMON, COUNT, Option, Section, check_options
from terraport_pipeline.workflow.build import BuildOptions


@dataclass(frozen=True, slots=True)
class Rock:
    hardness: Annotated[float, Option(least=1, most=10)] = 6.0
    """On the scale of Mohs."""

    def __post_init__(self) -> None:
        check_options(self)


@dataclass(frozen=True, slots=True)
class Water:
    depth_m: Annotated[float | None, Option()] = None
    """Metres."""
    is_salt: Annotated[bool, Option(flags=("--salt",))] = False
    """Whether it is salt."""


@dataclass(frozen=True, slots=True)
class Site:
    """A place."""

    survey: Annotated[Path, Option(is_argument=True)]
    """What to read."""
    points: Annotated[int, Option(notation=COUNT)] = 5_000
    """How many points."""
    name: Annotated[str | None, Option(unset="none")] = None
    """For people."""
    rock: Annotated[Rock, Section("Ground")] = field(default_factory=Rock)
    """The ground."""
    water: Annotated[Water | None, Section("Ground")] = None
    """The lake."""
    resume: Annotated[bool, Option(heading="Machine")] = True
    """Take up."""


def run(*arguments: str) -> tuple[int, str, list[tuple[Site, bool]]]:
    received: list[tuple[Site, bool]] = []

    def survey(
        site: Site, quiet: Annotated[bool, typer.Option("--quiet", help="No table.")] = False
    ) -> None:
        """Look at a site."""
        if quiet and site.name == "broken":
            raise OptionError("this")
        received.append((site, quiet))

    app = typer.Typer(rich_markup_mode="markdown")  # as the command line has it
    app.command()(command_of(survey))
    result = CliRunner().invoke(app, arguments, env={"COLUMNS": "100", "NO_COLOR": "1"})
    return result.exit_code, result.output, received


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], Site(Path("a"))),
        (["--points", "1.5k", "--name", "x"], Site(Path("a"), 1500, "x")),
        (["--hardness", "9"], Site(Path("a"), rock=Rock(9.0))),
        (["--depth-m", "3"], Site(Path("a"), water=Water(3.0))),
        (["--salt"], Site(Path("a"), water=Water(None, is_salt=True))),
        (["--no-resume"], Site(Path("a"), resume=False)),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_options_come_in_as_the_dataclass(arguments: list[str], expected: Site) -> None:
    assert run("a", *arguments) == (0, "", [(expected, False)])


def test_options_of_the_function_itself_stay_beside_it() -> None:
    assert run("a", "--quiet")[2] == [(Site(Path("a")), True)]


def test_errors_are_one_line_and_exit_with_2() -> None:
    expected = "error: hardness 11; expected 1 to 10\n"
    assert run("a", "--hardness", "11") == (2, expected, [])
    assert run("a", "--name", "broken", "--quiet") == (2, "error: this\n", [])
    code, output, _ = run()
    assert code == 2
    assert "Missing argument" in output


def test_the_help_has_headings_types_ranges_and_defaults() -> None:
    _, text, _ = run("--help")
    sections = text.replace("│", " ").split("╭─ ")
    headings = [section.split(" ─")[0] for section in sections[1:]]
    assert headings == ["Arguments", "Options", "Ground", "Machine"]
    words = {
        heading: " ".join(section.split())
        for heading, section in zip(headings, sections[1:], strict=True)
    }
    assert "Look at a site." in sections[0]
    assert "What to read." in words["Arguments"]
    assert "--points COUNT How many points. [default: 5,000]" in words["Options"]
    assert "--name <str> For people. [default: none]" in words["Options"]
    assert "--quiet" in words["Options"]
    assert "--hardness <float> On the scale of Mohs. 1 to 10. [default: 6]" in words["Ground"]
    assert "--no-resume" in words["Machine"]


def test_build_shows_ten_options_first_and_the_rest_under_headings() -> None:
    app = typer.Typer(add_completion=False)
    register(app)
    command: Any = typer.main.get_command(app)
    first = [
        parameter.opts[0]
        for parameter in command.params
        if getattr(parameter, "rich_help_panel", "") in (None, COMMON)
        and parameter.param_type_name == "option"
    ]
    assert first == [
        "--output", "--name", "--max-points", "--photos", "--cameras", "--resume", "--max-memory",
        "--profile", "--report", "--quiet",
    ]  # fmt: skip
    headings = {getattr(parameter, "rich_help_panel", None) for parameter in command.params}
    assert {"Surface", "Regions and segments", "Textures", "Machine and tiles"} < headings


def test_no_two_options_of_a_build_have_one_name() -> None:
    flags = [flag for _, option in options_of(BuildOptions) for flag in option.flags]
    assert len(flags) == len(set(flags))


def test_every_option_of_a_build_says_what_it_does_and_its_default() -> None:
    for _, option in options_of(BuildOptions):
        assert len(option.help.split()) >= 4, option.name
        assert option.help.endswith("."), option.name
        needs_default = option.default is None and option.name != "photos"
        assert not needs_default or option.option.unset, f"{option.name}: what does None come to?"


def test_what_is_no_option_is_so_on_purpose() -> None:
    def unmarked(options_class: Any) -> set[str]:
        hints = get_type_hints(options_class, include_extras=True)
        names = set()
        for option_field in fields(options_class):
            marks = getattr(hints[option_field.name], "__metadata__", ())
            if any(isinstance(mark, Option) for mark in marks):
                continue  # its value may be a dataclass: one option all the same
            if not marks and option_field.name != "options":
                names.add(f"{options_class.__module__.rpartition('.')[2]}.{option_field.name}")
            for inner in get_args(hints[option_field.name]):
                for nested in (inner, *get_args(inner)):
                    if is_dataclass(nested) and isinstance(nested, type):
                        names |= unmarked(nested)
        return names

    assert unmarked(BuildOptions) == {"clean.outlier_deviations", "clean.normal_neighbours"}
