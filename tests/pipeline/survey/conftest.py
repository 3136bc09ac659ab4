"""A delivery of nine tiles, with what stands beside tiles."""

from __future__ import annotations

from pathlib import Path

import pytest
from pipeline.laz_files import Hill, write_tiles

MESH = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
MESH += "property float z\nelement face 1\nproperty list uchar int i\nend_header\n"
MESH += "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


@pytest.fixture
def delivery(tmp_path: Path) -> Path:
    """Nine tiles in two folders, with what stands beside tiles in a real delivery."""
    folder = tmp_path / "delivery"
    tiles = write_tiles(folder / "tiles" / "north", Hill(900))
    (folder / "tiles" / "south").mkdir()
    for path in tiles[4:]:
        path.rename(folder / "tiles" / "south" / path.name)
    (folder / "README.txt").write_text("Delivered on Monday.\n")
    (folder / "cameras.csv").write_text("x,y,z\n1,2,3\n4,5,6\n")
    (folder / "area.prj").write_text("PROJCS[]")
    (folder / "mesh.ply").write_text(MESH)
    (folder / "photos").mkdir()
    (folder / "photos" / "1.jpg").write_bytes(b"\xff\xd8")
    (folder / "tiles" / "north" / "._tile_1.laz").write_bytes(b"AppleDouble")
    (folder / ".work").mkdir()
    (folder / ".work" / "old.laz").write_bytes(b"LASF")
    return folder
