"""PURE modules say so and import nothing that is not."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import terraport_server

FOLDER = Path(terraport_server.__file__).parent
PURE = [
    "actions", "aim_ledger", "client_addresses", "deliveries", "errors", "fair_queue", "greeting",
    "group_homes", "group_state", "group_talk", "groups", "id_set", "merged_metrics", "outbox",
    "pick_talk", "plans", "rate", "selection", "session", "strangers", "token_scopes", "transfer",
]  # fmt: skip
FORBIDDEN = {
    "asyncio", "socket", "fastapi", "starlette", "uvicorn", "websockets", "httpx", "time",
    "datetime", "random", "secrets", "threading", "pathlib", "os", "terraport_store",
}  # fmt: skip


@pytest.mark.parametrize("name", PURE)
def test_pure_modules_import_no_clock_and_no_network(name: str) -> None:
    tree = ast.parse((FOLDER / f"{name}.py").read_text())
    docstring = ast.get_docstring(tree) or ""
    assert "PURE" in docstring
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module or ""]
        for imported in names:
            assert imported.partition(".")[0] not in FORBIDDEN, imported
            if imported.startswith("terraport_server."):
                assert imported.partition(".")[2] in PURE


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_modules_are_short_and_export_what_they_name(path: Path) -> None:
    text = path.read_text()
    assert text.count("\n") < 400
    tree = ast.parse(text)
    assert any(
        isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__"
        for node in tree.body
    )
