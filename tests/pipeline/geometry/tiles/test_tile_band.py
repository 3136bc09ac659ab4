from __future__ import annotations

import numpy as np
from coloured_ground import ground
from memory_tiles import MemoryTiles

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.tiles.tile_band import (
    Banded,
    faces_outside,
    piece_near,
    touching,
    with_band,
)


def band(tiles: MemoryTiles, tile: int, reach_m: float) -> Banded:
    boxes = np.stack([tiles.box(i) for i in range(tiles.count)])
    pieces = []
    for i in sorted([tile, *touching(boxes, tile, reach_m)]):
        mesh, border = tiles.meshes[i], tiles.border(i)
        box = None if i == tile else boxes[tile]
        pieces.append(
            piece_near(
                i, mesh.vertices, mesh.faces, mesh.colours, (border.rows, border.ids), box, reach_m
            )
        )
    return with_band(pieces, tile)


def test_the_tile_is_whole_and_the_band_is_as_wide_as_asked() -> None:
    mesh = ground(30)  # 2 m a cell
    tiles = MemoryTiles.of(mesh, 3)
    banded = band(tiles, 4, 5.0)
    piece = tiles.meshes[4]
    assert (banded.vertices[banded.faces[banded.own]] == piece.vertices[piece.faces]).all()
    box = tiles.box(4)
    corners = banded.vertices[banded.faces]
    apart = np.maximum(box[:3] - corners, corners - box[3:]).max(axis=2).min(axis=1)
    assert apart.max() <= 5.0
    # every face of the mesh that reaches so far is there
    whole = mesh.vertices[mesh.faces]
    near = np.maximum(box[:3] - whole, whole - box[3:]).max(axis=2).min(axis=1) <= 5.0
    assert len(banded.faces) == near.sum()
    assert [tile for tile, _ in banded.rows_of_tiles] == list(range(9))
    assert sum(len(rows) for _, rows in banded.rows_of_tiles) == len(banded.faces)
    assert banded.is_own.sum() == len(piece.faces)


def test_tiles_hang_together_over_their_borders() -> None:
    mesh = ground(30)
    tiles = MemoryTiles.of(mesh, 3)
    banded = band(tiles, 4, 100.0)
    assert len(banded.vertices) == len(mesh.vertices)  # shared ones are there once
    pairs, _ = face_pairs(banded.faces, len(banded.vertices))
    assert len(pairs) == len(face_pairs(mesh.faces, len(mesh.vertices))[0])
    assert (banded.colours[banded.faces].sum() == mesh.colours[mesh.faces].sum()).all()


def test_both_sides_of_a_border_see_the_same_faces_in_the_same_order() -> None:
    tiles = MemoryTiles.of(ground(30), 2)
    first_band, second_band = band(tiles, 0, 8.0), band(tiles, 1, 8.0)

    def listed(banded: Banded) -> list[tuple[int, int]]:
        return [(tile, row) for tile, rows in banded.rows_of_tiles for row in rows.tolist()]

    first, second = listed(first_band), listed(second_band)
    shared = set(first) & set(second)
    assert len(shared) > 100
    assert [face for face in first if face in shared] == [face for face in second if face in shared]


def test_a_tile_alone_has_no_band() -> None:
    tiles = MemoryTiles.of(ground(10), 1)
    banded = band(tiles, 0, 5.0)
    assert (banded.faces == tiles.meshes[0].faces).all()
    assert touching(np.array([[0.0, 0, 0, 1, 1, 1], [9.0, 0, 0, 9.5, 1, 1]]), 0, 2.0) == []


def test_faces_outside_stay_clear() -> None:
    mesh = ground(30)
    box = np.array([20.0, -5.0, 20.0, 40.0, 5.0, 40.0])
    rows = faces_outside(mesh.vertices, mesh.faces, box, 4.0)
    corners = mesh.vertices[mesh.faces[rows]]
    assert not ((corners > 16.0) & (corners < 44.0))[..., [0, 2]].all(axis=2).any()
    assert len(mesh.faces) - 15 * 15 * 2 * 1.4 < len(rows) < len(mesh.faces) - 14 * 14 * 2
