"""A running service for tests on real sockets; the SDK's socket tests use these too."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from server.grid_scene import GridScene, write_grid_scene

from terraport_server import BackgroundServer
from terraport_store import SurveyUnits

TOKEN = "a-token-that-is-long-enough"


@pytest.fixture(scope="session")
def scenes_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `grid`, `feet` (36 small segments) and `big` (36 of about 300 KB)."""
    root = tmp_path_factory.mktemp("scenes")
    write_grid_scene(root / "grid")
    feet = SurveyUnits(horizontal_m=1200 / 3937, height_m=0.3048)
    write_grid_scene(root / "feet", cells=2, name="feet", survey_units=feet)
    write_grid_scene(root / "big", cells=80, name="big")
    return root


@pytest.fixture(scope="session")
def grid(scenes_dir: Path) -> GridScene:
    """What stands in `grid`."""
    return _read(scenes_dir / "grid")


@pytest.fixture(scope="session")
def big(scenes_dir: Path) -> GridScene:
    """What stands in `big`."""
    return _read(scenes_dir / "big")


@pytest.fixture(scope="session")
def server(scenes_dir: Path) -> Iterator[BackgroundServer]:
    """An open service with the default limits, but for the number of clients and messages."""
    with BackgroundServer(
        scenes_dir, max_sessions_per_ip=100, max_messages_per_s=10_000.0
    ) as running:
        yield running


@pytest.fixture
def token() -> str:
    """The token of services that ask for one."""
    return TOKEN


def _read(path: Path) -> GridScene:
    from terraport_store import Scene

    with Scene.open(path) as scene:
        payloads = [bytes(scene.payload(segment)) for segment in range(len(scene.index))]
        return GridScene(path, scene.manifest, payloads, [])
