from __future__ import annotations

import numpy as np

from terraport_pipeline.engines.camera_files import read_cameras
from terraport_pipeline.engines.camera_files.write_colmap import write_colmap
from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.synth.colmap_text import offset_text, points_text


def test_the_offset_is_found_and_understood_by_the_reader(tmp_path) -> None:
    lens = Lens(width=640, height=480, fx=450.0, fy=449.0, cx=322.0, cy=238.0)
    view = View("A.JPG", lens, np.diag([1.0, -1.0, -1.0]), np.array([5.0, 60.0, -7.0]))
    origin = np.array([641_200.0, 8_594_700.0, 1287.0])
    offset = np.array([641_000.0, 8_595_000.0, 0.0])
    write_colmap(tmp_path, [view], origin=origin, offset=(641_000.0, 8_595_000.0, 0.0))
    (tmp_path / "OFFSET.txt").write_text(offset_text(offset, 32735, "q.laz"))
    (restored,) = read_cameras(tmp_path, origin=origin, crs=None).views
    np.testing.assert_allclose(restored.position, view.position, atol=1e-6)


def test_points_are_numbered_and_coloured() -> None:
    text = points_text(np.array([[1.5, 2.25, -3.0]]), np.array([[1, 2, 3]], np.uint8))
    assert text.splitlines()[-1] == "1 1.5000 2.2500 -3.0000 1 2 3 0"
