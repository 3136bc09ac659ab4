"""The base's image, drawn from the colours of a detail in tiles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from memory_tiles import MemoryTiles

from terraport_pipeline.engines.images import decode_image
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.tiles import base_atlas
from terraport_pipeline.stages.tiles.base_atlas import BaseAtlas, Options, image_bytes

SPACING_M = 0.5


def sheet(cells: int, step_m: float) -> Mesh:
    """A hilly square; its colours are stripes 4 m wide, two of which lie in a cell of the base."""
    x, z = (g.ravel() for g in np.meshgrid(*[np.arange(cells + 1) * step_m] * 2, indexing="ij"))
    vertices = np.stack([x, np.sin(x / 9.0), -z], axis=1).astype(np.float32)
    index = np.arange(len(x), dtype=np.int32).reshape(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack(f, -1).reshape(-1, 3) for f in ((a, b, c), (a, c, d))])
    colours = np.stack([np.where(x % 8 < 4, 200, 40), 0 * x + 90, 2 * z], axis=1).astype(np.uint8)
    return Mesh(vertices, faces, vertex_normals(vertices, faces), colours, {})


BASE, DETAIL = sheet(8, 8.0), sheet(128, SPACING_M)


def draw(tmp_path: Path, tiles: int = 2, threads: int = 1) -> BaseAtlas:
    return base_atlas.run(
        BASE,
        MemoryTiles.of(DETAIL, tiles),
        SPACING_M,
        Options(side=256),
        Context(tmp_path, threads=threads),
    )


def test_the_image_shows_what_the_base_has_no_vertices_for(tmp_path: Path) -> None:
    atlas = draw(tmp_path)
    info = atlas.info
    assert (info.source, info.segments, info.base_side, info.max_side) == ("vertex", 0, 128, 0)
    # None finer than the points, and rather a tenth coarser than an image twice as large.
    assert SPACING_M <= info.texel_m < 1.2 * SPACING_M
    image = decode_image(atlas.textures.texture(0).data)
    # Middles of stripes, across one face: what its corners alone would say is 200 everywhere.
    uvs = atlas.textures.uvs(slice(None), 0)
    corners = BASE.vertices[BASE.faces].astype(float)
    seen = []
    for weights in ([0.6, 0.2, 0.2], [0.2, 0.6, 0.2], [0.2, 0.2, 0.6]):
        place = np.einsum("c,fck->fk", weights, corners)
        at = np.einsum("c,fck->fk", weights, uvs.astype(float)) * image.shape[1::-1]
        column, row = np.floor(at).astype(int).T
        red = image[row, column, 0].astype(float)
        middle = np.abs(place[:, 0] % 4 - 2) < 1
        expected = np.where(place[:, 0] % 8 < 4, 200.0, 40.0)
        seen.append(np.abs(red - expected)[middle])
    assert np.concatenate(seen).mean() < 12
    assert len(np.concatenate(seen)) > 50


def test_tiles_and_threads_change_nothing(tmp_path: Path) -> None:
    one = draw(tmp_path, tiles=1)
    three = draw(tmp_path, tiles=3, threads=2)
    assert one.textures.wedges.tolist() == three.textures.wedges.tolist()
    apart = [decode_image(a.textures.texture(0).data).astype(int) for a in (one, three)]
    # Vertices that tiles share count once in each.
    assert np.abs(apart[0] - apart[1]).mean() < 1


def test_what_is_stored_is_what_was_made(tmp_path: Path) -> None:
    atlas = draw(tmp_path)
    again = base_atlas.FORM.restore(base_atlas.FORM.store(atlas), atlas.facts)
    assert again.info == atlas.info
    assert again.textures.texture(0) == atlas.textures.texture(0)


def test_the_image_has_the_bytes_that_the_mesh_leaves() -> None:
    assert image_bytes(200_000, 0) + 200_000 * 9 <= base_atlas.MAX_BASE_BYTES
    assert image_bytes(10_000_000, 3) > 0


def test_a_side_that_is_no_side_is_refused() -> None:
    with pytest.raises(OptionError, match="base texture 1000 pixels"):
        Options(side=1000)
