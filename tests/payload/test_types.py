from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from terraport_payload import types

ROOT = Path(__file__).parents[2]
PACKAGES = [
    "client_sdk/python",
    "payload",
    "pipeline",
    "research",
    "server",
    "store",
]  # the wire has its own
SPELLED_OUT = re.compile(
    r"NDArray\[\s*(?:Any|np\.(?:bool_|u?int(?:8|16|32|64)|float(?:16|32|64)|integer|floating))\b"
)


@pytest.mark.parametrize("name", [name for name in types.__all__ if not name.startswith("Any")])
def test_a_name_says_its_dtype(name: str) -> None:
    scalar_type = getattr(types, name).__args__[1].__args__[0]
    assert np.dtype(scalar_type) == np.dtype(name.lower())


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_has_array_types_of_its_own(package: str) -> None:
    modules = [path for path in (ROOT / package).rglob("*.py") if path.name != "types.py"]
    assert modules
    assert [str(path) for path in modules if SPELLED_OUT.search(path.read_text())] == []
