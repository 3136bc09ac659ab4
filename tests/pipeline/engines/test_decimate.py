from __future__ import annotations

import numpy as np
from pipeline.mesh_facts import face_normals

from terraport_pipeline.engines.decimate import decimate
from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh


def hills(side: int) -> tuple[np.ndarray, np.ndarray]:
    x, z = np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0))
    y = 2 * np.sin(x / 8) * np.cos(z / 8)
    vertices = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1).astype(np.float32)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + side + 1, corner + 1], axis=1),
            np.stack([corner + 1, corner + side + 1, corner + side + 2], axis=1),
        ]
    )
    return vertices, faces.astype(np.int32)


def border(vertices: np.ndarray, faces: np.ndarray) -> set[tuple[float, ...]]:
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    return {tuple(vertices[v].tolist()) for v in np.unique(unique[count == 1])}


def test_fewer_faces_the_same_border_and_shape() -> None:
    vertices, faces = hills(60)
    fewer_vertices, fewer = decimate(vertices, faces, max_faces=2000)
    assert 1500 < len(fewer) <= 2000
    assert border(fewer_vertices, fewer) == border(vertices, faces)
    assert distances_to_mesh(vertices, fewer_vertices, fewer).max() < 0.2
    assert (face_normals(fewer_vertices, fewer)[0][:, 1] > 0).all()


def test_small_enough_is_left_alone() -> None:
    vertices, faces = hills(5)
    same_vertices, same = decimate(vertices, faces, max_faces=len(faces))
    assert same_vertices is vertices
    assert same is faces


def test_same_input_same_bytes() -> None:
    first, second = (decimate(*hills(40), max_faces=700) for _ in range(2))
    assert first[0].tobytes() == second[0].tobytes()
    assert first[1].tobytes() == second[1].tobytes()
