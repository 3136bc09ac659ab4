"""Options declared once: a field of a frozen dataclass says all there is to say of an option.

Its type gives the choices, its default the default, its docstring the help, and :class:`Option`,
which marks it, the rest::

    trim_spacings: Annotated[float, Option(least=1)] = 4.0
    \"\"\"Cut surface farther than this many sample spacings from a sample.\"\"\"

``__post_init__`` calls :func:`check_options`; :mod:`terraport_pipeline.cli.from_options` makes the
command line.
"""

from __future__ import annotations

import ast
import functools
import inspect
import math
import re
import textwrap
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

from terraport_pipeline.errors import OptionError
from terraport_pipeline.extent import Extent

__all__ = [
    "BYTES",
    "COMMON",
    "COUNT",
    "EXTENT",
    "LENGTH",
    "OFFSET",
    "Notation",
    "Option",
    "OptionField",
    "Section",
    "check_options",
    "docstrings_of",
    "format_bytes",
    "option_fields",
    "parse_bytes",
    "parse_count",
    "parse_length",
    "parse_offset",
]

COMMON: Final = "Options"
"""Heading of the few options that people need first; typer's own, for options without one."""

_WIDEST_METAVAR: Final = 20
"""Characters of choices that leave room for the help beside them in 80 columns."""

_COUNTS: Final = {"": 1, "k": 1_000, "m": 1_000_000}
_LENGTHS: Final = {"": 1.0, "mm": 0.001, "cm": 0.01, "m": 1.0, "km": 1000.0, "ft": 0.3048}
_SIZES: Final = {"": 1, "k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40}


def parse_count(text: str, what: str = "count") -> int:
    """Read a number of things such as ``300000``, ``300_000``, ``300k`` or ``1.5M``.

    `what` names it in the error.

    Raises
    ------
    OptionError
        When the text is none of these.

    Examples
    --------
    >>> parse_count("1.5M")
    1500000
    """
    match = re.fullmatch(r"([0-9][0-9_,]*(?:\.[0-9]+)?)\s*([kKmM]?)", text.strip())
    if match is None:
        raise OptionError(f"{what} {text!r}; expected a number such as 300000, 300k or 5M")
    number = float(match[1].replace("_", "").replace(",", ""))
    return round(number * _COUNTS[match[2].lower()])


def format_bytes(count: float) -> str:
    """Format a size in human-readable form.

    Examples
    --------
    >>> format_bytes(999), format_bytes(1010), format_bytes(1_234_567)
    ('999 B', '1.01 kB', '1.23 MB')
    """
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000 or unit == "GB":
            return f"{count:.0f} B" if unit == "B" else f"{count:.3g} {unit}"
        count /= 1000
    raise AssertionError  # pragma: no cover - the last unit always returns


def parse_bytes(text: str, what: str = "size") -> int:
    """Read a number of bytes with an optional binary suffix; `what` as :func:`parse_count`.

    Raises
    ------
    OptionError
        The text is not a number with k, M, G or T; only a million and more may go without.

    Examples
    --------
    >>> parse_bytes("1.5G")
    1610612736
    """
    match = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]+)?)\s*([kmgt]?)(?:i?b)?\s*", text.lower())
    # --max-memory 8 certainly does not mean 8 bytes.
    if match is None or (not match[2] and float(match[1]) < _SIZES["m"]):
        raise OptionError(f"{what} {text!r}; expected a number with K, M, G or T, for example 8G")
    return int(float(match[1]) * _SIZES[match[2]])


def parse_offset(text: str, what: str = "offset") -> tuple[float, float, float]:
    """Read an offset ``E,N,H`` in metres; `what` as :func:`parse_count`.

    Raises
    ------
    OptionError
        The text is not three finite numbers.

    Examples
    --------
    >>> parse_offset("576600,5188100,0")
    (576600.0, 5188100.0, 0.0)
    """
    try:
        east, north, height = (float(number) for number in text.split(","))
    except ValueError:
        east = north = height = math.nan
    if not all(map(math.isfinite, (east, north, height))):
        raise OptionError(
            f"{what} {text!r}; expected three finite numbers E,N,H in metres, for example "
            "576600,5188100,0"
        )
    return east, north, height


def parse_length(text: str, what: str = "length") -> float:
    """Read a length in metres, with or without its unit; `what` as :func:`parse_count`.

    Raises
    ------
    OptionError
        The text is not a number, or its unit none of mm, cm, m, km and ft (0.3048 m).

    Examples
    --------
    >>> parse_length("15m"), parse_length("15"), parse_length("50 ft")
    (15.0, 15.0, 15.24)
    """
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+(?:e-?[0-9]+)?)\s*([a-z]*)\s*", text.lower())
    if match is None or match[2] not in _LENGTHS:
        raise OptionError(f"{what} {text!r}; expected metres, for example 15m (or cm, km, ft)")
    return float(match[1]) * _LENGTHS[match[2]]


@dataclass(frozen=True, slots=True)
class Notation:
    """How people write a value that is no plain number or word."""

    metavar: str
    """Stands for the value in the help."""
    parse: Callable[[Any, str], Any]
    """Takes what was written and the option's name."""
    show: Callable[[Any], str]
    """What :attr:`parse` reads back."""
    type: Any = str
    """What is written: one word, or a tuple of several."""


COUNT: Final = Notation("COUNT", parse_count, "{:,}".format)
LENGTH: Final = Notation("METRES", parse_length, "{:,.10g}".format)
BYTES: Final = Notation("BYTES", parse_bytes, lambda size: f"{round(size / 2**20, 3):.10g} MiB")
EXTENT: Final = Notation(
    "XMIN YMIN XMAX YMAX",
    lambda values, _what: Extent(*values),
    str,
    tuple[float, float, float, float],
)
OFFSET: Final = Notation("E,N,H", parse_offset, lambda offset: ",".join(map(repr, offset)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """Marks a field as an option, and says what its type, default and docstring do not."""

    flags: tuple[str, ...] = ()
    """Names on the command line, the long one first, where the field's own would not do."""
    is_argument: bool = False
    """Given by its place, not by a name."""
    many: bool = False
    """May be given several times: the field's value is a tuple."""
    heading: str = ""
    """That it stands under in the help, where not its section's; :data:`COMMON` is the first."""
    unset: str = ""
    """What is done where the default is None, for people."""
    notation: Notation | None = None
    least: float | None = None
    most: float | None = None
    above: float | None = None
    below: float | None = None
    """Bounds: ``least`` and ``most`` may be reached, ``above`` and ``below`` not."""
    unit: str = ""
    """Of the value, in messages and ranges."""

    def holds(self, value: float) -> bool:
        """Whether a number is within the bounds; NaN is within none."""
        return (
            (self.least is None or value >= self.least)
            and (self.most is None or value <= self.most)
            and (self.above is None or value > self.above)
            and (self.below is None or value < self.below)
        )

    def range(self) -> str:
        """Say the bounds: ``3 to 16``, ``above 0, at most 100``; empty without any."""
        low = self._bound("at least", self.least) or self._bound("above", self.above)
        high = self._bound("at most", self.most) or self._bound("below", self.below)
        if self.least is not None and high:
            joined = f"{self.show(self.least)} to {high.removeprefix('at most ')}"
        else:
            joined = ", ".join(filter(None, (low, high)))
        return f"{joined} {self.unit}".strip() if joined else ""

    def show(self, value: Any) -> str:
        """Write a value as it may be given."""
        if self.notation is not None:
            return self.notation.show(value)
        return f"{value:,.10g}" if isinstance(value, float) else f"{value}"

    def _bound(self, word: str, bound: float | None) -> str:
        return "" if bound is None else f"{word} {self.show(bound)}"


@dataclass(frozen=True, slots=True)
class Section:
    """Marks a field that holds a dataclass of options, and gives them their heading in the help."""

    heading: str


@dataclass(frozen=True, slots=True)
class OptionField:
    """One field that is marked: everything known of the option."""

    name: str
    type: Any
    """Without None; of a ``Literal`` str."""
    choices: tuple[str, ...]
    """Of a ``Literal``; else empty."""
    default: Any
    """``dataclasses.MISSING`` where one must be given."""
    help: str
    option: Option

    @property
    def flags(self) -> tuple[str, ...]:
        """Its names on the command line, the long one first."""
        return self.option.flags or (f"--{self.name.replace('_', '-')}",)

    @property
    def key(self) -> str:
        """The long name as an identifier."""
        return self.flags[0].removeprefix("--").replace("-", "_")

    @property
    def words(self) -> str:
        """Its name in messages: the long flag without hyphens and unit."""
        return self.key.removesuffix(f"_{self.option.unit}").replace("_", " ")

    @property
    def metavar(self) -> str | None:
        """Stands for the value in the help; None: its type's name."""
        if self.option.notation is not None:
            return self.option.notation.metavar
        choices = "|".join(self.choices)
        return choices if 0 < len(choices) <= _WIDEST_METAVAR else None

    @property
    def text(self) -> str:
        """Help for people: what it does, its range, its default."""
        sentences, bounds = [self.help], self.option.range()
        if bounds:
            sentences.append(f"{bounds[0].upper()}{bounds[1:]}.")
        if self.default_text:
            sentences.append(f"[default: {self.default_text}]")
        return " ".join(sentences)

    @property
    def default_text(self) -> str:
        """The default for people; empty for what must be given, and for flags."""
        if self.default is MISSING or self.default is None or isinstance(self.default, bool):
            return self.option.unset
        return self.option.show(self.default)

    def read(self, value: Any) -> Any:
        """Read what was written on the command line."""
        notation = self.option.notation
        if self.option.many:
            return tuple(value)
        return value if notation is None or value is None else notation.parse(value, self.words)

    def stated(self, value: Any) -> str:
        """Say for messages what was received: ``grid cell 4 m``."""
        return f"{self.words} {self.option.show(value)} {self.option.unit}".strip()

    def check(self, value: Any) -> None:
        """Refuse a value that is none of the choices, or out of bounds."""
        option = self.option
        if self.choices and value not in self.choices:
            raise OptionError(f"{self.words} {value!r}; expected {_listed(self.choices)}")
        if isinstance(value, int | float) and not option.holds(value):
            raise OptionError(f"{self.stated(value)}; expected {option.range()}")


def option_fields(options_class: type) -> tuple[OptionField, ...]:
    """List the marked fields of a dataclass in their order, without those of dataclasses in it."""
    return _option_fields(options_class)


@functools.cache  # reads source; called whenever options are made
def _option_fields(options_class: type) -> tuple[OptionField, ...]:
    hints, docs = get_type_hints(options_class, include_extras=True), docstrings_of(options_class)
    return tuple(
        _option_field(field.name, hints[field.name], field.default, docs.get(field.name, ""))
        for field in fields(options_class)
        if _mark(hints[field.name]) is not None
    )


def check_options(options: Any) -> None:
    """Refuse options out of their choices and bounds; None stands for the default.

    Raises
    ------
    OptionError
        Names the option, what was received and what was expected.
    """
    for field in option_fields(type(options)):
        value = getattr(options, field.name)
        if value is not None:
            field.check(value)


def docstrings_of(options_class: type) -> dict[str, str]:
    """Read the strings under the fields of a class and of those it derives from."""
    docs: dict[str, str] = {}
    for base in reversed(options_class.__mro__[:-1]):
        [body] = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        assert isinstance(body, ast.ClassDef)
        for field, text in zip(body.body, body.body[1:], strict=False):
            if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
                continue
            if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
                docs[field.target.id] = " ".join(str(text.value.value).split())
    return docs


def _mark(hint: Any) -> Option | None:
    marks = [mark for mark in getattr(hint, "__metadata__", ()) if isinstance(mark, Option)]
    return marks[0] if marks else None


def _option_field(name: str, hint: Any, default: Any, text: str) -> OptionField:
    mark, type_ = _mark(hint), get_args(hint)[0]
    assert mark is not None
    if mark.many:  # one value or a tuple of them: the type of one
        type_ = get_args(type_)[0]
    if get_origin(type_) is not Literal and type(None) in get_args(type_):
        [type_] = [member for member in get_args(type_) if member is not type(None)]
    choices = get_args(type_) if get_origin(type_) is Literal else ()
    return OptionField(name, str if choices else type_, choices, default, text, mark)


def _listed(choices: tuple[str, ...]) -> str:
    return choices[0] if len(choices) == 1 else f"{', '.join(choices[:-1])} or {choices[-1]}"
