"""What a stage runs is behind the module that it names as its code: no change there is missed."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

import terraport_pipeline
from terraport_pipeline import code_digest
from terraport_pipeline.code_digest import modules_behind
from terraport_pipeline.import_graph import modules_needed, needs_of

WORKFLOW = Path(terraport_pipeline.__file__).parent / "workflow"
STEPS = [*sorted(path.stem for path in WORKFLOW.glob("*_step.py")), "tile_ground"]

KEPT = {"terraport_pipeline.stages.contract", "terraport_pipeline.engines.readers.npy_columns"}
"""How results are kept and read back, which decides none."""

BELOW = ("engines", "geometry", "published", "stages", "survey")
"""Rooms whose code decides results; the workflow hands them on, and its own code does not count."""


def stages_of(
    tree: ast.Module, bound: dict[str, str]
) -> Iterator[tuple[set[str], ast.Call, ast.stmt]]:
    """Code, call and what is around it of every stage: a call with a name and a module of ours."""
    for around in tree.body:
        for call in ast.walk(around):
            if not isinstance(call, ast.Call) or len(call.args) < 3:
                continue
            also = [word.value for word in call.keywords if word.arg == "also"]
            named = [call.args[1], *(one for each in also for one in ast.walk(each))]
            code = {bound[one.id] for one in named if isinstance(one, ast.Name) and one.id in bound}
            first = call.args[1]
            if isinstance(first, ast.Name) and code_digest._path(bound.get(first.id, "")):
                yield code, call, around


def followed(tree: ast.Module, around: ast.stmt, nodes: Iterable[ast.AST]) -> list[ast.AST]:
    """All of some expressions, and of the functions and classes of this source that they name."""
    bodies = {
        node.name: node
        for node in [*_nested(around), *tree.body]
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
    }
    every: list[ast.AST] = []
    waiting = list(nodes)
    while waiting:
        inner = list(ast.walk(waiting.pop()))
        every += inner
        names = {node.id for node in inner if isinstance(node, ast.Name)}
        waiting += [bodies.pop(name) for name in names & set(bodies)]
    return every


def _nested(around: ast.stmt) -> Iterator[ast.AST]:
    """Functions within functions; methods are reached by no plain name."""
    for node in ast.walk(around):
        if isinstance(node, ast.FunctionDef):
            yield from (inner for inner in ast.walk(node) if inner is not node)


@pytest.mark.parametrize("step", STEPS)
def test_what_a_stage_runs_is_behind_its_code(step: str) -> None:
    tree = ast.parse((WORKFLOW / f"{step}.py").read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    bound = needs_of(list(imports)).exports
    stages = list(stages_of(tree, bound))
    assert stages
    missed = []
    for code, call, around in stages:
        nodes = followed(tree, around, call.args[2:4])
        names = needs_of([*imports, *nodes]).names
        run, _ = modules_needed(names, code_digest._needs, code_digest._modules_below)
        below = {name for name in run if name.split(".")[1:2] and name.split(".")[1] in BELOW}
        behind = {name for module in code for name in modules_behind(module)}
        missed += [
            f"line {call.lineno}: {', '.join(sorted(code))} runs {name}"
            for name in sorted(below - behind - KEPT)
        ]
    assert not missed, "\n".join(missed)
