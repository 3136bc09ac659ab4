from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.cover.skirt import add_skirt, drop_skirt

VERTICES = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1]], np.float32)
FACES = np.array([[0, 1, 2], [2, 1, 3]], np.int32)


def test_a_strip_hangs_from_every_border_edge_and_goes_again() -> None:
    vertices, faces, hem = add_skirt(VERTICES, FACES, drop_m=0.5)
    assert len(faces) == 2 + 2 * 4
    assert (hem == VERTICES - np.array([0, 0.5, 0], np.float32)).all()
    # Every edge of the surface has two faces now; wound like the surface beside it.
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    directed_edges = {tuple(edge) for edge in edges.tolist()}
    on_top = [(a, b) for a, b in directed_edges if a < 4 and b < 4]
    assert all((b, a) in directed_edges for a, b in on_top)
    order = np.random.default_rng(1).permutation(len(vertices))
    number = np.argsort(order)
    kept = drop_skirt(vertices[order], number[faces].astype(np.int32), hem)
    assert (order[kept] == FACES).all()
