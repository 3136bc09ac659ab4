"""The Godot client in Godot 3 itself, on a screen that nobody sees, against the real service.

Skipped where the engine or a compiler is missing, unless ``TERRAPORT_GODOT=required``.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from faults.service import Service
from godot import engine
from server.grid_scene import write_grid_scene
from store.tiny_scene import write_tiny_scene


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give the tests of this folder the time that they may need: they may wait for a compiler."""
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.timeout(900))


@pytest.fixture(scope="session")
def godot() -> engine.Engine:
    """The project with its library."""
    reason = engine.missing()
    if reason is not None:
        if os.environ.get("TERRAPORT_GODOT") == "required":
            pytest.fail(f"TERRAPORT_GODOT=required, but the client cannot be run ({reason})")
        pytest.skip(f"the Godot client cannot be run ({reason})")
    return engine.build()


@pytest.fixture(scope="session")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `grid`, `levels` (two of them) and `tiny` (small), `big` (10 MB)."""
    root = tmp_path_factory.mktemp("scenes")
    write_grid_scene(root / "grid")
    write_grid_scene(root / "levels", levels=2)
    write_grid_scene(root / "big", cells=80, name="big")
    write_tiny_scene(root / "tiny")
    return root


@pytest.fixture(scope="session")
def server(scenes: Path) -> Iterator[Service]:
    """The service in a process of its own, open."""
    with Service(scenes, max_sessions_per_ip=100) as running:
        yield running
