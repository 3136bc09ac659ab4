from __future__ import annotations

from pathlib import Path

import pytest

from terraport_pipeline.errors import SurveyError
from terraport_pipeline.progress import NullProgress
from terraport_research.depth_sweep import find_scene, sweep


def test_faces_grow_with_depth_until_points_end(tmp_path: Path) -> None:
    scene = sweep("quarry", None, (4, 5), 3000, tmp_path, threads=2, progress=NullProgress())
    assert [row.depth for row in scene.rows] == [4, 5]
    assert scene.rows[1].faces > 3 * scene.rows[0].faces > 0
    assert all(row.solved_faces >= row.faces for row in scene.rows)
    assert scene.our_depth == 5  # at most what was asked
    assert all(row.memory_bytes > 0 and row.cpu_s > 0 for row in scene.rows)


def test_scenes_are_found_or_named(tmp_path: Path) -> None:
    assert find_scene("quarry", None) == ("Synthetic quarry", None)
    with pytest.raises(SurveyError, match="--data"):
        find_scene("red_rocks", None)
    with pytest.raises(SurveyError, match="is not there"):
        find_scene("red_rocks", tmp_path)
    (tmp_path / "pit.laz").touch()
    assert find_scene(str(tmp_path / "pit.laz"), None) == ("pit", tmp_path / "pit.laz")
