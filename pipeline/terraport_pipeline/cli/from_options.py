"""Commands made from options dataclasses: their fields are the options.

What an option is called, takes, defaults to and says in the help stands at its field alone
(:mod:`terraport_pipeline.option`). Dataclasses within the dataclass are walked through; the field
that holds one gives its options their heading by a :class:`~terraport_pipeline.option.Section`.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import MISSING, fields, is_dataclass
from typing import Annotated, Any, get_args, get_type_hints

import typer
from rich.console import Console

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.option import COMMON, OptionField, Section, option_fields

__all__ = ["command_of", "options_of"]


def command_of(function: Callable[..., None]) -> Callable[..., None]:
    """Make a typer command of a function that takes options as dataclasses.

    Parameters
    ----------
    function : callable
        Parameters annotated with a dataclass become its options; the others are as typer wants
        them.

    Returns
    -------
    callable
        Takes every option by its own name, makes the dataclasses and calls the function. Errors are
        reported as by :func:`~.edge.reporting_errors`.
    """
    hints = get_type_hints(function, include_extras=True)
    hints.pop("return", None)
    defaults = {
        name: parameter.default
        for name, parameter in inspect.signature(function).parameters.items()
    }
    classes = {name: held for name, hint in hints.items() if (held := _dataclass_in(hint))}

    @functools.wraps(function)
    def command(context: typer.Context, **given: Any) -> None:
        with reporting_errors(Console(stderr=True, soft_wrap=True)):
            sources = {key: context.get_parameter_source(key) for key in given}
            # A profile's defaults are defaults: they alone make no dataclass that is None without.
            stated = {
                key
                for key, source in sources.items()
                if source and source.name not in {"DEFAULT", "DEFAULT_MAP"}
            }
            own = {name: given[name] for name in hints if name not in classes}
            dataclasses = {name: _make(held, given, stated) for name, held in classes.items()}
            function(**own, **dataclasses)

    parameters = [_keyword("context", typer.Context)]
    for name, hint in hints.items():
        if name in classes:
            options = _options_in(hint, COMMON)
            parameters += [_parameter(field, heading) for heading, field in options]
        else:
            parameters.append(_keyword(name, hint, defaults[name]))
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return command


def options_of(options_class: type, heading: str = COMMON) -> Iterator[tuple[str, OptionField]]:
    """Walk through all options of a dataclass, each with its heading in the help."""
    marked = {field.name: field for field in option_fields(options_class)}
    for name, hint in get_type_hints(options_class, include_extras=True).items():
        if name in marked:
            yield marked[name].option.heading or heading, marked[name]
        else:
            yield from _options_in(hint, heading)


def _options_in(hint: Any, heading: str) -> Iterator[tuple[str, OptionField]]:
    """Walk through the options of the dataclass that a hint holds, if any."""
    inner = _dataclass_in(hint)
    if inner is not None:
        sections = [mark.heading for mark in get_args(hint) if isinstance(mark, Section)]
        yield from options_of(inner, sections[0] if sections else heading)


def _dataclass_in(hint: Any) -> type | None:
    """Give the dataclass of ``Options``, ``Options | None`` or either of them annotated."""
    bare = get_args(hint)[0] if hasattr(hint, "__metadata__") else hint
    members: tuple[type, ...] = get_args(bare) or (bare,)
    return next((member for member in members if is_dataclass(member)), None)


def _make(options_class: type, given: Mapping[str, Any], stated: AbstractSet[str]) -> Any:
    """Make the dataclass; one within it that is None by default is, unless an option was stated."""
    hints = get_type_hints(options_class)
    marked = {field.name: field for field in option_fields(options_class)}
    values: dict[str, Any] = {}
    for field in fields(options_class):
        inner = _dataclass_in(hints[field.name])
        if field.name in marked:
            values[field.name] = marked[field.name].read(given[marked[field.name].key])
        elif inner is not None and (
            field.default is not None or stated & {option.key for _, option in options_of(inner)}
        ):
            values[field.name] = _make(inner, given, stated)
    return options_class(**values)


def _parameter(field: OptionField, heading: str) -> inspect.Parameter:
    """Describe an option to typer: its flags, type, help and heading."""
    option, default = field.option, field.default
    if option.notation is not None and default is not None:
        default = option.notation.show(default)
    flags = list(field.flags)
    if default is True:
        flags[0] += f"/--no-{flags[0].removeprefix('--')}"
    described: Any
    if option.is_argument:
        described = typer.Argument(help=field.text, metavar=field.metavar or field.key.upper())
    else:
        described = typer.Option(
            *flags,
            help=field.text,
            metavar=field.metavar,
            show_default=default is True,  # of flags alone: the text has all others
            rich_help_panel=heading,
        )
    kind = field.type if option.notation is None else option.notation.type
    kind = list[kind] if option.many else kind  # type: ignore[valid-type]
    kind = kind | None if default is None else kind
    return _keyword(
        field.key,
        Annotated[kind, described],
        inspect.Parameter.empty if default is MISSING else default,
    )


def _keyword(
    name: str, annotation: Any, default: Any = inspect.Parameter.empty
) -> inspect.Parameter:
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default
    )
