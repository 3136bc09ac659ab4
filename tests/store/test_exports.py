from __future__ import annotations

import importlib
import pkgutil

import pytest

import terraport_store

MODULES = [info.name for info in pkgutil.iter_modules(terraport_store.__path__)]


@pytest.mark.parametrize("name", MODULES)
def test_every_module_lists_what_it_has(name: str) -> None:
    module = importlib.import_module(f"terraport_store.{name}")
    assert [entry for entry in module.__all__ if not hasattr(module, entry)] == []


def test_package_exports_are_some_modules_exports() -> None:
    exported = {
        entry
        for name in MODULES
        for entry in importlib.import_module(f"terraport_store.{name}").__all__
    }
    assert set(terraport_store.__all__) <= exported
