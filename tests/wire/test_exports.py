"""What the package imports."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import terraport_wire

PACKAGE = Path(terraport_wire.__file__).parent


@pytest.mark.parametrize("path", sorted(PACKAGE.glob("*.py")), ids=lambda path: path.stem)
def test_modules_import_no_io(path: Path) -> None:
    forbidden = {"asyncio", "socket", "time", "datetime", "websockets", "fastapi", "httpx"}
    forbidden |= {"pathlib", "io", "os"}
    imported = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            imported |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            imported.add(node.module.split(".")[0])
    assert not imported & forbidden


def test_the_package_imports_little() -> None:
    code = "import sys, terraport_wire; print(*sorted({m.split('.')[0] for m in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & {"pydantic", "fastapi", "websockets", "terraport"}
