"""The engine clients' cores, compiled, against the real service.

Skipped where the compilers are missing, unless ``TERRAPORT_ENGINES=required``. The engines
themselves are not run: neither Unity nor Unreal can be installed here.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import pytest
from conformance.scene.axes_scene import write_axes_scene
from engines import cores
from engines import unreal as unreal_build
from engines.unity import Unity
from engines.unreal import Unreal
from faults.service import Service
from server.grid_scene import write_grid_scene
from store.tiny_scene import write_tiny_scene

TOKEN = "a-token-that-is-long-enough"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give the tests of this folder the time that they may need: they may wait for compilers."""
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.timeout(900))


def skip_or_fail(reason: str) -> NoReturn:
    """Skip, or fail where the engines' tests are asked for."""
    if os.environ.get("TERRAPORT_ENGINES") == "required":
        pytest.fail(f"TERRAPORT_ENGINES=required, but {reason}")
    pytest.skip(reason)


@pytest.fixture(scope="session")
def unity() -> Unity:
    """Core of the Unity package and its programs."""
    reason = cores.missing_for("csharp")
    if reason is not None:
        skip_or_fail(f"the C# core cannot be compiled ({reason})")
    return Unity(cores.csharp())


@pytest.fixture(scope="session")
def unreal() -> Unreal:
    """The Unreal plugin's core, and its module on stubs of the engine."""
    reason = unreal_build.missing()
    if reason is not None:
        skip_or_fail(f"the Unreal plugin cannot be compiled ({reason})")
    return unreal_build.unreal()


@pytest.fixture(scope="session")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `grid`, `levels` (two), `tiny` (small), `big` (3.7 MB), `bigger`, `axes`."""
    root = tmp_path_factory.mktemp("scenes")
    write_grid_scene(root / "grid")
    write_grid_scene(root / "levels", levels=2)
    write_grid_scene(root / "big", cells=80, name="big")
    write_grid_scene(root / "bigger", cells=130, name="bigger")
    write_axes_scene(root / "axes")
    write_tiny_scene(root / "tiny")
    return root


@pytest.fixture(scope="session")
def server(scenes: Path) -> Iterator[Service]:
    """The service in a process of its own, open."""
    with Service(scenes, max_sessions_per_ip=100) as running:
        yield running


@pytest.fixture(scope="session")
def guarded(scenes: Path) -> Iterator[Service]:
    """The same service for those alone who show `TOKEN`."""
    with Service(scenes, token=TOKEN, max_sessions_per_ip=100) as running:
        yield running
