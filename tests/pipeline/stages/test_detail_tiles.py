"""Pieces of the detail on disk."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.errors import WorkDirectoryError
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages.tiles.detail_tiles import StoredTiles

MESH = Mesh(
    vertices=np.array([[0, 0, 0], [0, 1, 2], [3, 0, 0]], dtype=np.float32),
    faces=np.array([[0, 1, 2]], dtype=np.int32),
    normals=np.tile(np.float32([0, 1, 0]), (3, 1)),
    colours=np.full((3, 3), 90, dtype=np.uint8),
    attributes={"grade": np.array([1, 2, 3], dtype=np.float32)},
)


def stored(folder: Path) -> StoredTiles:
    tile_folder = folder / "tile-00000"
    tile_folder.mkdir()
    for field in ("vertices", "faces", "normals", "colours"):
        np.save(tile_folder / f"{field}.npy", getattr(MESH, field))
    np.save(tile_folder / "attribute-0.npy", MESH.attributes["grade"])
    np.save(tile_folder / "border-rows.npy", np.array([1], dtype=np.int32))
    np.save(tile_folder / "border-shared.npy", np.array([1], dtype=np.int32))
    box, ids = np.array([[0.0, 0, 0, 3, 1, 2]]), (np.array([3, 7]),)
    return StoredTiles(folder, ("tile-00000",), box, (1,), (3,), ("d0",), ("grade",), 8, ids, "abc")


def test_a_tile_is_read_as_it_was_kept(tmp_path: Path) -> None:
    tiles = pickle.loads(pickle.dumps(stored(tmp_path)))
    assert tiles.count == 1
    assert tiles.attributes == ("grade",)
    assert (tiles.face_count(0), tiles.vertex_count(0)) == (1, 3)
    assert tiles.box(0).tolist() == [0, 0, 0, 3, 1, 2]
    mesh = tiles.load(0)
    for field in ("vertices", "faces", "normals", "colours"):
        np.testing.assert_array_equal(getattr(mesh, field), getattr(MESH, field))
    np.testing.assert_array_equal(mesh.attributes["grade"], MESH.attributes["grade"])
    assert (tiles.digest, tiles.digest_of(0)) == ("abc", "d0")
    with pytest.raises(IndexError, match="tile 1; there are 1"):
        tiles.load(1)


def test_what_is_shared(tmp_path: Path) -> None:
    border = stored(tmp_path).border(0)
    assert (border.rows.tolist(), border.ids.tolist()) == ([1], [7])


def test_a_damaged_tile_is_named(tmp_path: Path) -> None:
    tiles = stored(tmp_path)
    (tmp_path / "tile-00000" / "faces.npy").write_bytes(b"no")
    with pytest.raises(WorkDirectoryError, match=r"faces\.npy cannot be read"):
        tiles.load(0)
