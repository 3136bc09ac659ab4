"""What the package exports, and the examples in its docstrings."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import pytest

import terraport

MODULES = [
    module.name
    for module in pkgutil.walk_packages(terraport.__path__, "terraport.")
    if not module.name.endswith("__main__")
]


@pytest.mark.parametrize("name", MODULES)
def test_all_names_exist_and_docstrings_run(name: str) -> None:
    module = importlib.import_module(name)
    assert list(module.__all__) == [name for name in module.__all__ if hasattr(module, name)]
    assert doctest.testmod(module).failed == 0


@pytest.mark.parametrize("name", terraport.__all__)
def test_every_export_is_what_its_home_has(name: str) -> None:
    assert name in dir(terraport)
    value = getattr(terraport, name)
    home = terraport._HOMES.get(name)
    if home is None:
        assert value is importlib.import_module(f"terraport.{name}")
    else:
        assert value is getattr(importlib.import_module(f"terraport.{home}"), name)


def test_other_names_are_not_there() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'fly'"):
        _ = terraport.fly


@pytest.mark.parametrize("name", MODULES)
def test_modules_that_call_themselves_pure_are(name: str) -> None:
    """No I/O, no clock, no task among their imports."""
    module = importlib.import_module(name)
    if "\nPURE" not in (module.__doc__ or ""):
        return
    forbidden = {"asyncio", "httpx", "os", "pathlib", "random", "socket", "time", "websockets"}
    assert forbidden.isdisjoint(vars(module))
