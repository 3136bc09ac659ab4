from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.mesh.face_blocks import block_meshes, face_blocks, weld


def sheet(side: int) -> tuple[np.ndarray, np.ndarray]:
    x, z = np.meshgrid(np.arange(side + 1), np.arange(side + 1))
    vertices = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    first = np.stack([corner, corner + side + 1, corner + 1], axis=1)
    second = np.stack([corner + 1, corner + side + 1, corner + side + 2], axis=1)
    return vertices.astype(np.float32), np.concatenate([first, second]).astype(np.int32)


def test_blocks_are_bounded_and_make_the_whole_again() -> None:
    vertices, faces = sheet(40)
    blocks = face_blocks(vertices, faces, max_faces=500)
    counts = np.bincount(blocks)
    assert (counts > 0).all()
    assert counts.max() < 600  # a square of the ground more at most
    meshes = list(block_meshes(vertices, faces, blocks))
    assert [len(mesh[1]) for mesh in meshes] == counts.tolist()
    first = np.cumsum([0, *(len(points) for points, _ in meshes)])[:-1]
    joined = weld(
        np.concatenate([points for points, _ in meshes]),
        np.concatenate([some + base for (_, some), base in zip(meshes, first, strict=True)]),
    )
    assert len(joined[0]) == len(vertices)

    def rows(points: np.ndarray, some: np.ndarray) -> list[list[float]]:
        return sorted(points[some].reshape(-1, 9).tolist())

    assert rows(*joined) == rows(vertices, faces)


def test_nothing_has_no_blocks() -> None:
    none = np.zeros((0, 3), np.int32)
    assert face_blocks(np.zeros((0, 3), np.float32), none, max_faces=10).shape == (0,)


def test_welding_drops_faces_without_area() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 1], [-0.0, 0, 0]], np.float32)
    faces = np.array([[0, 1, 2], [2, 3, 1], [4, 3, 1]], np.int32)
    points, left = weld(vertices, faces)
    assert points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 0, 1]]
    assert left.tolist() == [[0, 2, 1], [0, 2, 1]]
