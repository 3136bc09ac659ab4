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
from pathlib import Path
from typing import Final, NamedTuple

import xxhash

from terraport_pipeline.import_graph import Needs, modules_needed, needs_of

__all__ = ["code_digest", "modules_behind", "without_docstrings"]

_OURS: Final = frozenset({"terraport_pipeline", "terraport_payload", "terraport_store"})

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
        parsed = _parsed(name)
        digest.update(b"" if parsed is None else parsed.code)
    return digest.hexdigest()


def modules_behind(module: str) -> list[str]:
    """List a module and all of ours that it imports or names, sorted.

    Examples
    --------
    >>> "terraport_pipeline.model" in modules_behind("terraport_pipeline.stages.clean")
    True
    """
    behind: set[str] = set()
    handing_on: set[str] = set()
    waiting = {module}
    while waiting:
        name = waiting.pop()
        needs = _needs(name)
        if name in behind or name in _NO_RESULT or needs is None:
            continue
        behind.add(name)
        used, passed = modules_needed(needs.names, _needs, _modules_below)
        handing_on |= passed - _NO_RESULT
        waiting |= used
    return sorted(behind | handing_on)


def without_docstrings(source: str) -> str:
    """Take the strings that stand alone out of a source, and nothing else."""
    return _without_docstrings(source, list(ast.walk(ast.parse(source))))


def _without_docstrings(source: str, nodes: list[ast.AST]) -> str:
    lines = source.splitlines(keepends=True)
    for node in nodes:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            rows = slice(node.lineno - 1, node.end_lineno)
            lines[rows] = [""] * len(lines[rows])
    return "".join(lines)


class _Parsed(NamedTuple):
    """A module, parsed and walked once: most stages have most modules behind them."""

    needs: Needs
    code: bytes
    """Its source without docstrings."""


@functools.cache
def _parsed(name: str) -> _Parsed | None:
    """Read a module of ours; None when it is none."""
    path = _path(name)
    if path is None:
        return None
    source = path.read_bytes().decode("utf-8")
    nodes = list(ast.walk(ast.parse(source)))
    needs = needs_of(nodes, name, package=path.name == "__init__.py")
    return _Parsed(needs, _without_docstrings(source, nodes).encode())


def _needs(name: str) -> Needs | None:
    """List what a module of ours needs; None when it is none."""
    parsed = _parsed(name)
    return None if parsed is None else parsed.needs


def _modules_below(package: str) -> list[str]:
    """Every module of a package, which itself counts."""
    path = _path(package)
    if path is None or path.name != "__init__.py":
        return [package]
    return [package, *(f"{package}.{one.stem}" for one in sorted(path.parent.glob("[!_]*.py")))]


@functools.cache
def _path(name: str) -> Path | None:
    """File of a module of ours; None when it is none."""
    root, *inner = name.split(".")
    if root not in _OURS:
        return None
    spec = importlib.util.find_spec(root)
    for folder in (spec and spec.submodule_search_locations) or ():
        stem = Path(folder, *inner)
        for path in (stem / "__init__.py", stem.with_name(f"{stem.name}.py")):
            if path.is_file():
                return path
    return None
