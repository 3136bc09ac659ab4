"""Where a build keeps the stages of a scene. PURE."""

from __future__ import annotations

from pathlib import Path

__all__ = ["default_work_directory"]


def default_work_directory(scene: Path) -> Path:
    """Name the directory beside a scene that its stages are kept in when no other is stated."""
    scene = scene.absolute()
    return scene.parent / f".{scene.name}.work"
