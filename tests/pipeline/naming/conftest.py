"""One scene for all, copied by tests that change it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from pipeline.naming.named_ground import write_named_ground


@pytest.fixture(scope="session")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not to be changed."""
    return write_named_ground(tmp_path_factory.mktemp("named") / "pit")


@pytest.fixture
def scene(published: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(published, tmp_path / "pit"))
