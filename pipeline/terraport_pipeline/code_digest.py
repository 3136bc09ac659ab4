"""Which code a stage's result depends on, as one digest.

A work directory outlives releases. A result may be taken up by another release only when the code
that made it is the same; a change elsewhere must not cost hours of reconstruction again. So the
digest is taken over the stage's module and every module of ours that it imports or names, directly
or not. Docstrings do not count: those of options are the help, and a better word there must cost
nothing.
"""

from __future__ import annotations

import ast
import functools
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import xxhash

__all__ = ["code_digest", "modules_behind", "without_docstrings"]

_OURS: Final = re.compile(r"terraport_(?:pipeline|payload|store)(?:\.\w+)+")
"""Names of our modules, also where they stand in a string (a child process's ``-m``)."""

_NO_RESULT: Final = frozenset(
    {"terraport_pipeline.progress", "terraport_pipeline.errors", "terraport_pipeline.option"}
)
"""What they hold changes what a build says or is told, never what it makes of that."""


@functools.cache
def code_digest(module: str) -> str:
    """Compute the XXH3-64 of a module's source and of all of ours behind it.

    Parameters
    ----------
    module : str
        Dotted name.

    Returns
    -------
    str
        16 hexadecimal digits.
    """
    digest = xxhash.xxh3_64()
    for name in modules_behind(module):
        digest.update(f"{name}\n".encode())
        digest.update(without_docstrings((_source(name) or b"").decode("utf-8")).encode())
    return digest.hexdigest()


def modules_behind(module: str) -> list[str]:
    """List a module and all of ours that it imports or names, sorted.

    Examples
    --------
    >>> "terraport_pipeline.model" in modules_behind("terraport_pipeline.stages.clean")
    True
    """
    modules: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in modules or name in _NO_RESULT:
            continue
        source = _source(name)
        if source is not None:
            modules.add(name)
            waiting += _named(source.decode("utf-8"))
    return sorted(modules)


def without_docstrings(source: str) -> str:
    """Take the strings that stand alone out of a source, and nothing else."""
    lines = source.splitlines(keepends=True)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            rows = slice(node.lineno - 1, node.end_lineno)
            lines[rows] = [""] * len(lines[rows])
    return "".join(lines)


def _named(source: str) -> Iterator[str]:
    """Every name of ours in a source; some may be no modules."""
    yield from _OURS.findall(source)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
            yield node.module


@functools.cache
def _source(name: str) -> bytes | None:
    """Source of a module of ours; None when it is none."""
    if not name.startswith(("terraport_pipeline", "terraport_payload", "terraport_store")):
        return None
    parent, _, last = name.rpartition(".")
    try:
        spec = importlib.util.find_spec(parent or last)
    except ModuleNotFoundError:  # a name inside a module, not a module
        return None
    if spec is None or spec.origin is None:
        return None
    if not parent:
        return Path(spec.origin).read_bytes()
    for folder in spec.submodule_search_locations or ():
        for path in (Path(folder) / f"{last}.py", Path(folder) / last / "__init__.py"):
            if path.is_file():
                return path.read_bytes()
    return None
