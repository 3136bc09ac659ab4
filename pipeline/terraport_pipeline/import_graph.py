"""Which modules a Python source needs: what it imports at any depth, and what its strings name.

PURE: sources come in as text. :mod:`~terraport_pipeline.code_digest` takes from it which code a
result depends on, ``.ci/changed.py`` which tests a change may break.

A name that a package only hands on (``from terraport_store import Scene``) leads to the module
that it comes from, not to all that the package hands on.
"""

from __future__ import annotations

import ast
import contextlib
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

__all__ = ["Needs", "modules_needed", "needs_of"]

_DOTTED: Final = re.compile(r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+")
_PREFIX: Final = re.compile(r"(?:[A-Za-z_]\w*\.)+")


@dataclass(frozen=True, slots=True)
class Needs:
    """What one source needs."""

    names: frozenset[str] = frozenset()
    """Dotted names, of modules and of what is in them; ``package.*`` is all of a package."""
    exports: dict[str, str] = field(default_factory=dict)
    """Name in this module to the dotted name from which it was imported."""


def needs_of(nodes: list[ast.AST], module: str = "", *, package: bool = False) -> Needs:
    r"""List what a source needs.

    An import counts where the name that it binds is used: a package that only hands names on needs
    nothing itself.

    Parameters
    ----------
    nodes : list[ast.AST]
        All of the parsed source (``ast.walk``).
    module : str
        Its dotted name, for relative imports.
    package : bool
        Whether it is an ``__init__.py``.

    Examples
    --------
    >>> tree = ast.parse("import a.b\nfrom c import d, e\nprint(a.b.f, d)")
    >>> sorted(needs_of(list(ast.walk(tree))).names)
    ['a.b.f', 'c.d']
    """
    bound = dict(_bindings(nodes, module if package else module.rpartition(".")[0]))
    inner = {id(node.value) for node in nodes if isinstance(node, ast.Attribute)}
    # Strings that are statements are prose, which names modules that nobody needs.
    inner |= {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    names: set[str] = set()
    for node in nodes:
        if id(node) in inner:
            continue
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            names.update(_names_in_text(node.value))
        elif isinstance(node, ast.Name | ast.Attribute):
            root, *attributes = _chain(node)
            if root in bound:
                if attributes and attributes[-1] == "__file__":  # whoever asks where it is reads it
                    attributes[-1] = "*"
                names.add(".".join([bound[root], *attributes]))
    return Needs(frozenset(names), bound)


def modules_needed(
    names: Iterable[str], needs: Callable[[str], Needs | None], below: Callable[[str], list[str]]
) -> tuple[set[str], set[str]]:
    """Find the modules to which dotted names lead.

    Parameters
    ----------
    names : Iterable[str]
        As in :attr:`Needs.names`.
    needs : Callable[[str], Needs | None]
        Of a module; None where there is no such module (of ours).
    below : Callable[[str], list[str]]
        Every module in a package.

    Returns
    -------
    used, passed : set[str], set[str]
        Modules whose own needs count, and packages that are run or hand a name on, no more.
    """
    used: set[str] = set()
    passed: set[str] = set()
    waiting, seen = list(names), set[str]()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        if name.endswith(".*"):
            used.update(below(name[:-2]))
            continue
        module, attributes = name, list[str]()
        while module and needs(module) is None:
            module, _, last = module.rpartition(".")
            attributes.insert(0, last)
        if not module:
            continue
        parents = module.split(".")[:-1]
        passed.update(
            parent
            for count in range(1, len(parents) + 1)
            if needs(parent := ".".join(parents[:count])) is not None
        )
        exports = needs(module).exports if attributes else {}  # type: ignore[union-attr]
        if attributes and attributes[0] in exports:
            passed.add(module)
            waiting.append(".".join([exports[attributes[0]], *attributes[1:]]))
        elif attributes and not parents and len(below(module)) > 1:
            # "terraport.v1" only looks like a module; a root package has no code of its own.
            passed.add(module)
        else:
            used.add(module)
    return used, passed - used


def _bindings(nodes: list[ast.AST], package: str) -> Iterator[tuple[str, str]]:
    """Local name and what it stands for, of every import at any depth."""
    for node in nodes:
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.asname is not None:
                    yield alias.asname, alias.name
                else:
                    root = alias.name.partition(".")[0]
                    yield root, root
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")
            above = ".".join(parents[: len(parents) - node.level + 1]) if node.level else ""
            source = ".".join(filter(None, (above, node.module)))
            for alias in node.names:
                yield alias.asname or alias.name, f"{source}.{alias.name}"


def _chain(node: ast.expr) -> list[str]:
    """``a.b.c`` as its names; starts with an empty one where the root is no name."""
    attributes: list[str] = []
    while isinstance(node, ast.Attribute):
        attributes.insert(0, node.attr)
        node = node.value
    return [node.id if isinstance(node, ast.Name) else "", *attributes]


def _names_in_text(text: str) -> Iterator[str]:
    """Names in a string: a child process's ``-m`` or program, a module that is imported late."""
    if "import " in text:
        with contextlib.suppress(SyntaxError):  # prose, or a program with gaps to fill in
            yield from needs_of(list(ast.walk(ast.parse(text)))).names
        # Also where a program has gaps: which module, if not which name in it.
        yield from re.findall(r"(?:from|import)\s+([A-Za-z_][\w.]*)", text)
    if _PREFIX.fullmatch(text):  # f"terraport_store.{name}"
        yield text + "*"
    yield from _DOTTED.findall(text)
