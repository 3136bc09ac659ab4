from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from terraport_pipeline.engines.camera_files import read_cameras
from terraport_pipeline.geometry.lens import Lens, View
from terraport_pipeline.synth.colmap_text import (
    cameras_text,
    images_text,
    offset_text,
    points_text,
)

LENS = Lens(
    width=640, height=480, fx=450.0, fy=449.0, cx=322.0, cy=238.0,
    radial=(-0.06, 0.02), tangential=(0.001, -0.0005),
)  # fmt: skip


def test_cameras_come_back_as_they_were(tmp_path) -> None:
    """Through the product's own reader, which finds the offset beside them."""
    rng = np.random.default_rng(1)
    views = [
        View(f"A_{n}.JPG", LENS, Rotation.random(rng=rng).as_matrix(), rng.normal(0, 50, 3))
        for n in range(12)
    ]
    origin = np.array([641_200.0, 8_594_700.0, 1287.0])
    offset = np.array([641_000.0, 8_595_000.0, 0.0])
    for name, text in (
        ("cameras.txt", cameras_text(views)),
        ("images.txt", images_text(views, origin - offset)),
        ("points3D.txt", points_text(np.ones((2, 3)), np.full((2, 3), 7, np.uint8))),
        ("OFFSET.txt", offset_text(offset, 32735, "q.laz")),
    ):
        (tmp_path / name).write_text(text)
    found = read_cameras(tmp_path, origin=origin, crs=None).views
    assert [view.name for view in found] == [view.name for view in views]
    for one, other in zip(found, views, strict=True):
        assert one.lens == other.lens
        np.testing.assert_allclose(one.position, other.position, atol=1e-6)
        np.testing.assert_allclose(one.rotation, other.rotation, atol=1e-9)


def test_points_are_numbered_and_coloured() -> None:
    text = points_text(np.array([[1.5, 2.25, -3.0]]), np.array([[1, 2, 3]], np.uint8))
    assert text.splitlines()[-1] == "1 1.5000 2.2500 -3.0000 1 2 3 0"
