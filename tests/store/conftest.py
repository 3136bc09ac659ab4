"""Fixtures of the store's tests."""

from __future__ import annotations

from pathlib import Path

import pytest
from store.tiny_scene import TinyScene, write_tiny_scene


@pytest.fixture
def tiny(tmp_path: Path) -> TinyScene:
    """A fresh scene of four segments that a test may damage."""
    return write_tiny_scene(tmp_path / "tiny")
