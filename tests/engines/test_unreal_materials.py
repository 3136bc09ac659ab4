"""The materials that Unreal's script makes are those that a scene looks for."""

from __future__ import annotations

import ast
import re
from typing import Final

from engines.cores import UNREAL

SCRIPT: Final = UNREAL / "Content" / "Python" / "terraport_materials.py"
LOADS: Final = UNREAL / "Source" / "Terraport" / "Private" / "TerraportMadeMaterials.h"


def made_names() -> list[str]:
    """Return the names of the script's materials: its own function, without the engine's module."""
    tree = ast.parse(SCRIPT.read_text(encoding="utf-8"))
    (function,) = (
        node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "materials"
    )
    scope: dict[str, object] = {}
    exec(compile(ast.Module([function], []), str(SCRIPT), "exec"), scope)
    materials = scope["materials"]
    assert callable(materials)
    return [name for name, *_ in materials()]


def test_what_is_made_is_what_is_found() -> None:
    made = made_names()
    (folder,) = re.findall(r'^FOLDER = "(.*)"', SCRIPT.read_text(encoding="utf-8"), re.MULTILINE)
    found = re.findall(r'TEXT\("(/Game/\S+)\.(\S+)"\)', LOADS.read_text(encoding="utf-8"))
    assert len(set(made)) == 8
    assert sorted(found) == sorted((f"{folder}/{name}", name) for name in made)
