from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import pytest
import typer
from typer.testing import CliRunner

from terraport_pipeline.build.flow import BuildOptions
from terraport_pipeline.cli.build import register
from terraport_pipeline.cli.from_options import command_of, options_of
from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import COMMON, COUNT, Option, Section, check_options


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
    code, said, _ = run()
    assert code == 2
    assert "Missing argument" in said


def test_the_help_has_headings_types_ranges_and_defaults() -> None:
    _, text, _ = run("--help")
    parts = text.replace("│", " ").split("╭─ ")
    headings = [part.split(" ─")[0] for part in parts[1:]]
    assert headings == ["Arguments", "Options", "Ground", "Machine"]
    words = {
        heading: " ".join(part.split()) for heading, part in zip(headings, parts[1:], strict=True)
    }
    assert "Look at a site." in parts[0]
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
        one.opts[0]
        for one in command.params
        if getattr(one, "rich_help_panel", "") in (None, COMMON) and one.param_type_name == "option"
    ]
    assert first == [
        "--output", "--name", "--max-points", "--engine", "--photos", "--cameras", "--resume",
        "--max-memory", "--report", "--quiet",
    ]  # fmt: skip
    headings = {getattr(one, "rich_help_panel", None) for one in command.params}
    assert {"Surface", "Regions and segments", "Textures", "Machine and tiles"} < headings


def test_no_two_options_of_a_build_have_one_name() -> None:
    flags = [flag for _, one in options_of(BuildOptions) for flag in one.flags]
    assert len(flags) == len(set(flags))


def test_every_option_of_a_build_says_what_it_does_and_its_default() -> None:
    for _, one in options_of(BuildOptions):
        assert len(one.help.split()) >= 4, one.name
        assert one.help.endswith("."), one.name
        needs_default = one.default is None and one.name != "photos"
        assert not needs_default or one.option.unset, f"{one.name}: what does None come to?"


def test_what_is_no_option_is_so_on_purpose() -> None:
    def unmarked(options_class: Any) -> set[str]:
        hints = get_type_hints(options_class, include_extras=True)
        names = set()
        for one in fields(options_class):
            marks = getattr(hints[one.name], "__metadata__", ())
            if not marks and one.name != "options":
                names.add(f"{options_class.__module__.rpartition('.')[2]}.{one.name}")
            for inner in get_args(hints[one.name]):
                for held in (inner, *get_args(inner)):
                    if is_dataclass(held) and isinstance(held, type):
                        names |= unmarked(held)
        return names

    assert unmarked(BuildOptions) == {"clean.outlier_deviations", "clean.normal_neighbours"}
