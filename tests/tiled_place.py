"""The rendered place of the tests of textures, cut into tiles whose photos are chosen."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from memory_tiles import MemoryTiles
from photo_scene import PhotoScene, photo_scene

from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.tiles import tiled_views
from terraport_pipeline.stages.tiles.tiled_views import TextureScale
from terraport_pipeline.stages.view_gains import view_gains


@cache
def site() -> PhotoScene:
    return photo_scene(crate=False)


@cache
def gains() -> np.ndarray:
    mesh = site().mesh
    return view_gains(mesh, site().views, site(), RayScene(mesh.vertices, mesh.faces, threads=1))


def opened() -> OpenPhotos:
    return OpenPhotos(tuple(site().views), site(), ())  # type: ignore[arg-type]


def scale() -> TextureScale:
    return TextureScale(site().mesh.vertices.min(axis=0).astype(np.float64), 40.0, 0.7)


@cache
def tiles(along: int) -> MemoryTiles:
    return MemoryTiles.of(site().mesh, along)


@cache
def chosen(along: int) -> tuple[dict[str, np.ndarray], ...]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tiled_views, "_BAND_EDGES", 10.0)  # 7 m: not the whole place
        return tuple(
            tiled_views.choose(
                tiles(along),
                tile,
                site().mesh,
                opened(),
                gains(),
                scale(),
                one_segment(tiles(along), tile),
                context(),
            ).arrays
            for tile in range(along * along)
        )


def one_segment(of: MemoryTiles, tile: int) -> np.ndarray:
    """All faces of a tile, and those of its band, in one segment."""
    return np.full(len(of.load(tile).faces), -1, np.int32)


def context(tmp_path=None) -> Context:
    return Context(scratch=tmp_path)  # type: ignore[arg-type]
