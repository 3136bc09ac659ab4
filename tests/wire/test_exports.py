"""The package's public names."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import terraport_wire

PACKAGE = Path(terraport_wire.__file__).parent
RE_EXPORTED = ("codec", "errors", "frames", "limits", "messages")


def test_the_package_exports_what_its_modules_do() -> None:
    expected = {"HELD_DTYPE", "ID_DTYPE", "LOAD_DTYPE"}
    for name in RE_EXPORTED:
        expected |= set(importlib.import_module(f"terraport_wire.{name}").__all__)
    assert set(terraport_wire.__all__) == expected
    assert len(terraport_wire.__all__) == len(expected)


@pytest.mark.parametrize("path", sorted(PACKAGE.glob("*.py")), ids=lambda path: path.stem)
def test_modules_import_no_io(path: Path) -> None:
    forbidden = {"asyncio", "socket", "time", "datetime", "websockets", "fastapi", "httpx"}
    if path.stem != "schema":  # its main() writes the generated files
        forbidden |= {"pathlib", "io", "os"}
    imported = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            imported |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            imported.add(node.module.split(".")[0])
    assert not imported & forbidden
    assert len(path.read_text().splitlines()) <= 400


def test_the_package_imports_little() -> None:
    code = "import sys, terraport_wire; print(*sorted({m.split('.')[0] for m in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & {"pydantic", "fastapi", "websockets", "terraport"}
