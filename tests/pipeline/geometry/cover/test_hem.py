from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.cover.hem import add_hem
from terraport_pipeline.geometry.mesh.border_edges import open_edges


def plate(n: int) -> tuple[np.ndarray, np.ndarray]:
    x, z = np.meshgrid(np.arange(n, dtype=np.float32), np.arange(n, dtype=np.float32))
    points = np.stack([x.ravel(), np.zeros(n * n, np.float32), z.ravel()], axis=1)
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)]).astype(np.int32)
    return points, faces


def test_a_plate_grows_on_all_sides_and_stays_one_sheet() -> None:
    points, faces = plate(5)
    wide, triangles = add_hem(points, faces, width_m=0.5)
    assert len(wide) == 25 + 16
    assert len(triangles) == len(faces) + 2 * 16
    assert wide[:, 0].min() == -0.5
    assert wide[:, 2].max() == 4.5
    assert np.all(wide[:, 1] == 0)
    # Wound as the plate: every face looks up, and the seam is closed.
    corners = wide[triangles].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normal[:, 1] > 0).all()
    assert open_edges(triangles, len(wide)).min() >= 25


def test_a_closed_body_has_no_hem() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    wide, triangles = add_hem(points, faces, width_m=1.0)
    assert wide is points
    assert triangles is faces
