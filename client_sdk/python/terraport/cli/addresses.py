"""Addresses where a path of this machine is taken: refused as they were typed, with what to do.

A path made of ``s3://bucket/a.laz`` is ``s3:/bucket/a.laz``, and what is said of that helps nobody.
So every option and argument of every verb that takes a path is looked at before it becomes one.
What takes addresses (scenes, mostly) takes text, and is not touched.
"""

from __future__ import annotations

import inspect
import itertools
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, get_args, get_type_hints
from urllib.parse import urlsplit

from terraport.errors import UsageError

__all__ = ["refuse_address", "refuse_addresses"]

_ADDRESS: Final = re.compile(
    r"([A-Za-z][A-Za-z0-9+.-]+(?=://)|(?:s3a?|gs|az|https?)(?=:/)):/{1,2}(.*)", re.DOTALL
)
"""Also with one slash, which some shells and habits leave."""

_WRITTEN: Final = frozenset({"output", "glb", "png", "trace", "picture", "density_map", "export"})
"""Options that name what is written; all others name what is read."""

_KEPT: Final = frozenset({"work", "cache_dir"})
"""Options that name a folder of this machine that is written and read again."""

_FETCH: Final = {
    "s3": "aws s3 cp {source} {target}",
    "s3a": "aws s3 cp {source} {target}",
    "gs": "gcloud storage cp {source} {target}",
    "az": "azcopy copy {source} {target}",
}


def refuse_addresses(verb: str, command: Any, words: Sequence[str]) -> None:
    """Refuse addresses among what was typed after a verb, where a path is taken.

    Parameters
    ----------
    verb : str
    command : click.Command
        The real one.
    words : sequence of str
        Before they are parsed: a path has lost its second slash.

    Raises
    ------
    UsageError
        Names the address, the option, and what to do.
    """
    inner = getattr(command, "commands", {}).get(words[0]) if words else None
    if inner is not None:  # a verb of several
        refuse_addresses(verb, inner, words[1:])
        return
    path_names = _path_names(command)
    for parameter, word in _values(command, words):
        if parameter.name in path_names:
            flags = [flag for flag in parameter.opts if flag.startswith("--")]
            option = flags[0] if flags else (parameter.metavar or parameter.name).upper()
            fault = refuse_address(verb, option, parameter.name, word)
            if fault is not None:
                raise UsageError(fault)


def refuse_address(verb: str, option: str, name: str, text: str) -> str | None:
    """Say why an address cannot stand where a path is taken; None for a path.

    Parameters
    ----------
    verb : str
    option : str
        As it is typed: ``--photos``; an argument's name in capitals.
    name : str
        Of the parameter.
    text : str
        What was typed.

    Examples
    --------
    >>> refuse_address("build", "SURVEY", "survey", "s3://b/a.laz").partition(";")[0]
    's3://b/a.laz is an address, and SURVEY a path of this machine'
    >>> refuse_address("inspect", "SURVEY", "survey", "a.laz") is None
    True
    """
    match = _ADDRESS.fullmatch(text)
    if match is None or Path(text).exists():
        return None
    text = f"{match[1]}://{match[2]}"
    return f"{text} is an address, and {option} a path of this machine; {_advice(verb, name, text)}"


def _advice(verb: str, name: str, text: str) -> str:
    if (verb, name) == ("build", "output"):
        return f"build the scene here, then: terraport upload SCENE {text}"
    if verb == "upload":
        return f"within object storage: terraport mv {text} s3://..."
    if name in _KEPT:
        return "expected a folder on a disk of this machine"
    command = _FETCH.get(urlsplit(text).scheme)
    if name in _WRITTEN:
        if command is None:
            return "write it here and bring it there"
        return f"write it here, then: {command.format(source='FILE', target=text)}"
    if command is None:
        is_web = urlsplit(text).scheme in {"http", "https"}
        return f"fetch it first: curl -O {text}" if is_web else "fetch it first"
    is_folder = not re.search(r"\.\w+$", text)
    target = text.rstrip("/").rpartition("/")[2] if is_folder else "."
    return f"fetch it first: {command.format(source=text, target=target)}" + (
        " --recursive" if is_folder else ""
    )


def _path_names(command: Any) -> frozenset[str]:
    """Names of the parameters whose values become paths, by the function's own annotations."""
    if command.callback is None:
        return frozenset()
    # One that was made of options dataclasses states its own signature.
    function = inspect.unwrap(command.callback, stop=lambda each: hasattr(each, "__signature__"))
    hints = get_type_hints(function)
    if hasattr(function, "__signature__"):
        parameters = inspect.signature(function).parameters
        hints = {name: each.annotation for name, each in parameters.items()}
    return frozenset(name for name, hint in hints.items() if _is_path(hint))


def _is_path(hint: Any) -> bool:
    """Whether a hint is Path, or one of it, several or none; annotated or not."""
    return hint is Path or any(_is_path(each) for each in get_args(hint))


def _values(command: Any, words: Sequence[str]) -> Iterator[tuple[Any, str]]:
    """Pair what was typed with the parameter that takes it; what is wrong is for the parser."""
    options = {flag: each for each in command.params for flag in each.opts if flag.startswith("-")}
    arguments = [each for each in command.params if each.param_type_name == "argument"]
    waiting, ended = iter(words), False
    count = 0
    for word in waiting:
        flag, _, value = word.partition("=")
        if word == "--":
            ended = True
        elif not ended and flag in options:
            option = options[flag]
            if value:
                yield option, value
            elif not getattr(option, "is_flag", False):
                for given in itertools.islice(waiting, max(1, option.nargs)):
                    yield option, given
        elif (ended or not word.startswith("-")) and arguments:
            yield arguments[min(count, len(arguments) - 1)], word
            count += 1
