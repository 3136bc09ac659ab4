"""Open edges of tiles, and how they meet."""

from __future__ import annotations

import numpy as np
from coloured_ground import cut_mesh, ground
from numpy.testing import assert_allclose, assert_array_equal

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.tiles.tile_seams import OpenEdges, match_seams, open_edges


def edges_of(mesh) -> OpenEdges:
    return open_edges(mesh.vertices, mesh.faces, face_pairs(mesh.faces, len(mesh.vertices)))


def test_the_open_edges_of_a_square_are_its_rim() -> None:
    mesh = ground(4)
    edges = edges_of(mesh)
    assert len(edges.face) == 16
    # Every end lies on the rim, and the lower end comes first.
    on_rim = (edges.ends.reshape(-1, 3)[:, [0, 2]] % 60.0 == 0.0).any(axis=1)
    assert on_rim.all()
    assert (edges.ends[:, 0] <= edges.ends[:, 3]).all()
    assert_allclose(edges.lengths_m().sum(), 240.0, rtol=0.05)


def test_the_seams_of_tiles_are_the_pairs_that_the_cut_parted() -> None:
    mesh = ground(12)
    pieces = cut_mesh(mesh, 3)
    seams = match_seams([edges_of(piece) for piece, _ in pieces])
    tile = np.empty(len(mesh.faces), np.int64)
    for number, (_, rows) in enumerate(pieces):
        tile[rows] = number
    pairs, _ = face_pairs(mesh.faces, len(mesh.vertices))
    cut_pairs = np.sort(pairs[tile[pairs[:, 0]] != tile[pairs[:, 1]]], axis=1)
    seam_pairs = np.stack(
        [
            [
                pieces[t][1][f]
                for t, f in zip(seams.tiles[:, side], seams.faces[:, side], strict=True)
            ]
            for side in (0, 1)
        ],
        axis=1,
    )
    assert_array_equal(np.unique(np.sort(seam_pairs, axis=1), axis=0), np.unique(cut_pairs, axis=0))
    faces, lengths = seams.of(4)  # the tile in the middle has seams all around
    assert len(faces) == len(lengths) == int((seams.tiles == 4).sum())


def test_rims_without_a_partner_are_no_seams() -> None:
    left, _ = cut_mesh(ground(6), 2)[0]
    seams = match_seams([edges_of(left)])
    assert len(seams.faces) == len(seams.length_m) == 0


def test_minus_zero_is_zero() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    first = edges_of_faces(corners)
    second = edges_of_faces(np.array([[-0.0, 0, 0], [1, 0, 0], [0, 0, -1]], np.float32))
    assert len(match_seams([first, second]).faces) == 1


def edges_of_faces(corners) -> OpenEdges:
    faces = np.array([[0, 1, 2]], np.int32)
    return open_edges(corners, faces, face_pairs(faces, 3))
