from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.mesh.border_edges import border_edges, open_edges


def strip(length: int) -> tuple[np.ndarray, np.ndarray]:
    """Cells of one metre in a row along x, two faces each, looking up."""
    x = np.repeat(np.arange(length + 1), 2)
    z = np.tile([0, 1], length + 1)
    vertices = np.stack([x, 0 * x, z], axis=1).astype(np.float32)
    cell = 2 * np.arange(length)
    faces = np.concatenate(
        [np.stack([cell, cell + 1, cell + 2], axis=1), np.stack([cell + 2, cell + 1, cell + 3], 1)]
    )
    return vertices, faces.astype(np.int32)


def test_border_edges_are_those_of_one_face_in_its_direction() -> None:
    vertices, faces = strip(3)
    border = border_edges(faces, len(vertices))
    directed = {(a, b) for f in faces.tolist() for a, b in zip(f, [*f[1:], f[0]], strict=True)}
    expected = sorted((a, b) for a, b in directed if (b, a) not in directed)
    assert border.tolist() == [list(edge) for edge in expected]
    assert len(border) == 8


def test_open_edges_of_a_plate_are_its_outline() -> None:
    at = np.arange(25).reshape(5, 5)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    edges = open_edges(faces.astype(np.int32), 25)
    assert len(edges) == 16
    assert not np.isin(edges, at[1:-1, 1:-1]).any()
    assert {tuple(e) for e in edges.tolist()} <= {
        tuple(e) for e in border_edges(faces.astype(np.int32), 25).tolist()
    }


def test_a_closed_surface_has_no_border() -> None:
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32)
    assert border_edges(faces, 4).shape == (0, 2)


def test_two_fans_whose_numbers_balance_have_a_border_each() -> None:
    """Vertex 0 joins faces (0, 1, 2) and (0, 4, 3): 1 - 2 + 4 - 3 is 0, and yet it is border."""
    edges = border_edges(np.array([[0, 1, 2], [0, 4, 3]], np.int32), 5)
    assert edges.tolist() == [[0, 1], [0, 4], [1, 2], [2, 0], [3, 0], [4, 3]]
