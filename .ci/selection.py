"""Which tests a change may break: those that reach a changed file, nearest first.

PURE: paths and texts come in. A test reaches what it, its conftests and its helpers import at any
depth (:mod:`terraport_pipeline.import_graph`, which also knows which code a build's results depend
on), the verbs of the command line that it names, and the files whose paths it spells. Other
languages are reached by rules (:data:`RULES`): no test imports them.
"""

from __future__ import annotations

import ast
import functools
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import Final

from terraport_pipeline.import_graph import Needs, modules_needed, needs_of

__all__ = ["RULES", "Selected", "Selection", "Tree"]

ROOTS: Final = (
    "client_sdk/python", "payload", "pipeline", "research", "server", "store", "wire",
    "tests", "benchmarks", "fuzz", "docker", ".ci",
)  # fmt: skip
"""Folders from which modules are imported."""

CLI: Final = "client_sdk/python/terraport/cli/__init__.py"
VERBS: Final = "client_sdk/python/terraport/cli/lazy.py"
"""Names the module of every verb; a test reaches those of the verbs that it names."""
PROGRAM: Final = 'with_name("terraport")'
"""How a test starts it as a program: it lies beside the interpreter."""

SMALL: Final = ("tests/wire", "tests/payload", "tests/store", "tests/sdk", "tests/server")
CORES: Final = (
    "tests/engines/test_unity_core.py",
    "tests/engines/test_unreal_core.py",
    "tests/engines",
)
RULES: Final[dict[str, tuple[str, ...]]] = {
    "client_sdk/web": (
        "tests/browser/test_landings.py",
        "tests/browser",
        "tests/test_hatch_page.py",
    ),
    "client_sdk/unity": (
        "tests/engines/test_unity_core.py",
        "tests/engines/test_unity_visits.py",
        "tests/engines",
    ),
    "client_sdk/unreal": CORES,
    "client_sdk/godot": ("tests/browser/test_godot.py",),
    "tests/conformance": ("tests/conformance", *CORES),
    "pyproject.toml": SMALL,
    ".ci": ("tests/test_audit.py", "tests/test_selection.py", *SMALL),
}
"""What no test imports: a file or folder, and the tests of it, nearest first."""

LATER: Final[dict[str, int]] = {
    "tests/socket": 2, "tests/pipeline": 3, "tests/faults": 4,
    "tests/browser": 5, "tests/engines": 5, "tests/end_to_end": 6,
}  # fmt: skip
"""Steps by which tests of a folder count as farther off, unless they are the change's own.

They start services, compile kernels, open browsers: so a codec's own tests come before a landing in
a browser, and that before the time is over.
"""


_PATH: Final = re.compile(r"[\w.-]+(?:/[\w.~-]+)*/?[\w-]+\.\w+|[\w.-]+(?:/[\w.~-]+)+")
"""A file, or a folder below another; a lone word is no path."""


@dataclass(frozen=True, slots=True)
class Selected:
    """A test file that reaches a change."""

    path: str
    steps: int
    """Imports between the two, with :data:`LATER`; 0 for the change's own test."""
    changed: str
    """The file through which it was reached first."""


@dataclass(frozen=True, slots=True)
class Selection:
    """What a change asks for."""

    tests: tuple[Selected, ...]
    """Nearest first."""

    def of(self, changed: str) -> list[Selected]:
        """List the tests that were reached through one of the changed files first."""
        return [test for test in self.tests if test.changed == changed]


@dataclass(frozen=True, slots=True)
class _Source:
    """What is kept of a Python file, or of one statement of a conftest."""

    needs: Needs
    strings: frozenset[str]
    identifiers: frozenset[str]
    """Names that may ask for a fixture: parameters, and strings (``usefixtures``)."""
    paths: frozenset[str]
    """Paths that it spells."""
    runs: bool
    """Whether it starts the command line as a program."""
    fixture: str | None = None
    """Name, of a fixture that runs only when it is asked for."""


class Tree:
    """The files of a checkout and what each Python one needs.

    Parameters
    ----------
    files : Iterable[str]
        Every path, relative to the root.
    read : Callable[[str], str]
        Text of one of them; asked of Python files alone.
    """

    def __init__(self, files: Iterable[str], read: Callable[[str], str]) -> None:
        self.files: Final = frozenset(files)
        self._read = read
        self._modules = dict(_modules(self.files))
        self._names = {path: name for name, path in self._modules.items()}

    @functools.cached_property
    def tests(self) -> list[str]:
        """Every test file."""
        return sorted(
            path
            for path in self.files
            if path.startswith("tests/") and PurePosixPath(path).match("test_*.py")
        )

    @functools.cached_property
    def _test_set(self) -> frozenset[str]:
        return frozenset(self.tests)

    def select(self, changed: Iterable[str]) -> Selection:
        """Find the tests that reach a change; files that are gone count as well."""
        changed = sorted(changed)
        users = self._users
        steps: dict[str, int] = {}
        through: dict[str, str] = {}
        queue: deque[str] = deque()
        for path in changed:
            # A package whose __init__ changed is changed for those who only pass through it.
            for node in (path, _passed(path)):
                steps[node], through[node] = 0, path
                queue.append(node)
        while queue:
            node = queue.popleft()
            for user in users.get(node, ()):
                if user not in steps:
                    steps[user], through[user] = steps[node] + 1, through[node]
                    queue.append(user)
        for path in changed:
            for far, test in self._by_rule(path):
                if far < steps.get(test, far + 1):
                    steps[test], through[test] = far, path
        stems = {PurePosixPath(path).stem: path for path in changed}
        selected = []
        for test in self.tests:
            own = stems.get(PurePosixPath(test).stem.removeprefix("test_"))
            if test in steps:
                later = next((n for folder, n in LATER.items() if _lies_in(test, folder)), 0)
                near = 0 if own or test in changed else max(steps[test], 1) + later
                selected.append(Selected(test, near, own or through[test]))
        return Selection(tuple(sorted(selected, key=lambda each: (each.steps, each.path))))

    def _by_rule(self, path: str) -> Iterator[tuple[int, str]]:
        """Yield the tests that :data:`RULES` names for a file, with steps."""
        for rule, folders in RULES.items():
            if _lies_in(path, rule):
                for far, folder in enumerate(folders, 1):
                    yield from ((far, test) for test in self.tests if _lies_in(test, folder))

    @functools.cached_property
    def _users(self) -> dict[str, list[str]]:
        """Of every file those that need it."""
        users: dict[str, list[str]] = {}
        for path in sorted(self.files):
            if path.endswith(".py"):
                for needed in self._edges(path):
                    users.setdefault(needed, []).append(path)
        return users

    def _edges(self, path: str) -> set[str]:
        """Files that one needs; a package that it only passes through by :func:`_passed`."""
        edges = self._imported(path) | self._spelt(path)
        if path in self._test_set:
            sources = self._asked_for(path)
            edges |= self._needed(name for source in sources for name in source.needs.names)
            edges |= {_passed(conftest) for conftest in self._conftests(path)}
            edges |= self._verbs(path, sources)
        return edges - {path}

    def _needed(self, names: Iterable[str]) -> set[str]:
        used, passed = modules_needed(names, self._needs, self._below)
        return {self._modules[name] for name in used if name in self._modules} | {
            _passed(self._modules[name]) for name in passed
        }

    @functools.cache  # noqa: B019 -- one tree a process
    def _imported(self, path: str) -> set[str]:
        return self._needed(self._source(path).needs.names)

    def _needs(self, module: str) -> Needs | None:
        path = self._modules.get(module)
        return None if path is None else self._source(path).needs

    def _below(self, package: str) -> list[str]:
        return [name for name in self._modules if f"{name}.".startswith(f"{package}.")]

    @functools.cache  # noqa: B019 -- one tree a process
    def _source(self, path: str) -> _Source:
        text = self._read(path)
        name = self._names.get(path, "")
        source = _source(ast.parse(text), text, name, package=path.endswith("__init__.py"))
        if path != VERBS:
            return source
        # The verbs' modules are reached by the names of the verbs.
        own = source.needs.names.intersection(source.needs.exports.values())
        return replace(source, needs=Needs(own, source.needs.exports))

    @functools.cache  # noqa: B019 -- one tree a process
    def _statements(self, conftest: str) -> list[_Source]:
        """Each statement with the imports; hooks of pytest left out: they are of no test's own."""
        body = [
            node
            for node in ast.parse(self._read(conftest)).body
            if not (isinstance(node, ast.FunctionDef) and node.name.startswith("pytest_"))
        ]
        imports = [node for node in body if isinstance(node, ast.Import | ast.ImportFrom)]
        return [
            replace(
                _source(ast.Module([*imports, node], []), ast.unparse(node)), fixture=_fixture(node)
            )
            for node in body
            if node not in imports
        ]

    def _conftests(self, test: str) -> list[str]:
        above = [(parent / "conftest.py").as_posix() for parent in PurePosixPath(test).parents]
        return [conftest for conftest in above if conftest in self.files]

    def _asked_for(self, test: str) -> list[_Source]:
        """Statements of its conftests, without fixtures that it does not ask for, or these do."""
        identifiers = set(self._source(test).identifiers)
        sources: list[_Source] = []
        left = [
            source for conftest in self._conftests(test) for source in self._statements(conftest)
        ]
        while now := [
            source for source in left if source.fixture is None or source.fixture in identifiers
        ]:
            sources += now
            left = [
                source
                for source in left
                if source.fixture is not None and source.fixture not in identifiers
            ]
            identifiers.update(*(source.identifiers for source in now))
        return sources

    def _verbs(self, test: str, sources: list[_Source]) -> set[str]:
        """Modules of the verbs that a test names, where it runs the command line."""
        strings = {text for source in sources for text in source.strings}
        needed = self._needed(name for source in sources for name in source.needs.names)
        runs = any(source.runs for source in sources) or CLI in needed
        waiting, seen = [test, *needed], set[str]()
        while waiting:
            path = waiting.pop()
            if path in seen or not path.startswith("tests/") or path not in self.files:
                continue
            seen.add(path)
            source = self._source(path)
            strings |= source.strings
            runs = runs or source.runs or CLI in self._imported(path)
            waiting += self._imported(path)
        names = [self._modules[module] for verb, module in self._verb_modules if verb in strings]
        return {CLI, *names} if runs else set()

    @functools.cached_property
    def _verb_modules(self) -> list[tuple[str, str]]:
        tree = ast.parse(self._read(VERBS) if VERBS in self.files else "")
        calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
        return [
            (str(node.args[0].value), str(node.args[1].value))
            for node in calls
            if ast.unparse(node.func) == "Verb"
            and isinstance(node.args[0], ast.Constant)
            and isinstance(node.args[1], ast.Constant)
        ]

    @functools.cached_property
    def _in_folder(self) -> dict[str, set[str]]:
        """Files in every folder, at any depth; tests are run, not read."""
        inside: dict[str, set[str]] = {}
        for path in self.files - self._test_set:
            for parent in PurePosixPath(path).parents:
                inside.setdefault(parent.as_posix(), set()).add(path)
        return inside

    def _spelt(self, path: str) -> set[str]:
        """Files whose paths, or folders, a source spells: from the root or a folder above it."""
        above = [parent.as_posix() for parent in PurePosixPath(path).parents]
        spelt: set[str] = set()
        for text in self._source(path).paths:
            for folder in above:
                whole = PurePosixPath(folder, text).as_posix()
                spelt |= self._in_folder.get(whole, {whole} & self.files)
        return spelt - self._test_set


def _modules(files: frozenset[str]) -> Iterator[tuple[str, str]]:
    """Dotted name and path of every Python file below a root."""
    for path in sorted(files):
        root = next((root for root in ROOTS if _lies_in(path, root)), None)
        if root is not None and path.endswith(".py"):
            name = path.removeprefix(f"{root}/").removesuffix(".py").replace("/", ".")
            yield name.removesuffix(".__init__"), path


def _lies_in(path: str, folder: str) -> bool:
    return path == folder or path.startswith(f"{folder}/")


def _passed(path: str) -> str:
    """Node of a file that is run on the way to another, and whose own needs do not count."""
    return f"{path} passed through"


def _source(tree: ast.Module, text: str, name: str = "", *, package: bool = False) -> _Source:
    nodes = list(ast.walk(tree))
    values = (node.value for node in nodes if isinstance(node, ast.Constant))
    strings = frozenset(value for value in values if isinstance(value, str))
    return _Source(
        needs_of(nodes, name, package=package),
        strings,
        strings.union(node.arg for node in nodes if isinstance(node, ast.arg)),
        frozenset(_paths_in(nodes)),
        PROGRAM in text.replace("'", '"'),
    )


def _fixture(node: ast.stmt) -> str | None:
    """Name of a fixture that runs only when it is asked for; None of all else."""
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return None
    text = " ".join(map(ast.unparse, node.decorator_list))
    return node.name if "fixture" in text and "autouse=True" not in text else None


def _paths_in(nodes: list[ast.AST]) -> Iterator[str]:
    """Paths that a source spells: ``ROOT / "spec" / "x.md"``, ``"fuzz/wire.py"``."""
    inner = {id(node.left) for node in nodes if isinstance(node, ast.BinOp)}
    for node in nodes:
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
            root, components = _division(node)
            text = ast.unparse(root)
            if (
                id(node) not in inner
                and components
                and ("__file__" in text or text.rpartition(".")[2].isupper())
            ):
                yield "/".join(components)
        elif (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and _PATH.fullmatch(node.value)
        ):
            yield node.value


def _division(node: ast.expr) -> tuple[ast.expr, list[str]]:
    """Left end of ``a / "b" / "c"`` and the strings, up to the first that is none."""
    components: list[str] = []
    while isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
        if isinstance(node.right, ast.Constant):
            components.insert(0, str(node.right.value))
        else:
            components.clear()
        node = node.left
    return node, components
