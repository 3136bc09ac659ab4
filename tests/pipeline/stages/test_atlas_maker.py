"""The atlas of one mesh, also of one that no image has room for."""

from __future__ import annotations

import numpy as np
import pytest
from photo_scene import PhotoScene, photo_scene

from terraport_pipeline.engines.images import decode_image
from terraport_pipeline.geometry.photos.photo_samples import neutral_gains
from terraport_pipeline.geometry.photos.view_choice import ViewChoice
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages.atlas_maker import AtlasMaker, BakedAtlas


def shown(mesh: Mesh, atlas: BakedAtlas) -> np.ndarray:
    """Level of the texel at every face's middle."""
    pixels = decode_image(atlas.image).astype(int)
    middle = (atlas.wedges.mean(axis=1) * 0.5).astype(int)
    return pixels[middle[:, 1], middle[:, 0]]


def dust(count: int) -> Mesh:
    """Loose triangles of any colour: each a chart of its own."""
    rng = np.random.default_rng(6)
    corner = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.3], [0.3, 0.0, 0.0]])
    places = rng.uniform(0.0, 100.0, (count, 1, 3))
    vertices = (places + corner).reshape(-1, 3).astype(np.float32)
    colours = np.repeat(rng.integers(20, 236, (count, 3)), 3, axis=0).astype(np.uint8)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return Mesh(vertices, faces, np.tile(np.float32([0, 1, 0]), (3 * count, 1)), colours)


@pytest.mark.parametrize("count", [1, 3000, 20_000])
def test_any_number_of_charts_ends_in_an_image(count: int) -> None:
    mesh = dust(count)
    atlas = AtlasMaker(mesh, (), None, None, None, "png", 85).make(np.arange(count), max_side=512)
    assert max(atlas.width, atlas.height) <= 512
    assert atlas.flat.sum() == max(0, count - 256)
    assert np.isnan(atlas.texels).tolist() == atlas.flat.tolist()
    truth = mesh.colours[mesh.faces[:, 0]].astype(int)
    error = np.abs(shown(mesh, atlas) - truth).max(axis=1)
    assert error[~atlas.flat].max() <= 1
    assert error[atlas.flat].max(initial=0) < 64  # one of 64 shared colours


def test_a_face_without_area_takes_its_vertices_colour() -> None:
    mesh = dust(3)
    mesh.vertices[mesh.faces[1]] = mesh.vertices[mesh.faces[1][0]]
    atlas = AtlasMaker(mesh, (), None, None, None, "png", 85).make(np.arange(3), max_side=256)
    assert atlas.flat.tolist() == [False, True, False]
    assert atlas.charts == 2
    truth = mesh.colours[mesh.faces[:, 0]].astype(int)
    assert np.abs(shown(mesh, atlas) - truth).max() <= 1


def photographed(site: PhotoScene, view: np.ndarray) -> ViewChoice:
    count = len(view)
    return ViewChoice(
        view=view,
        blend_view=np.full(count, -1, np.int32),
        blend_weight=np.zeros((count, 3), np.float32),
        correction=np.zeros((count, 3, 3), np.float16),
        gains=neutral_gains(len(site.views)),
    )


def test_charts_with_a_photo_are_kept_before_those_without() -> None:
    """Every second face has none, and there is room for 16 charts."""
    site = photo_scene(crate=False)
    rows = np.arange(0, 4000, 40)
    view = np.where(np.arange(len(site.mesh.faces)) % 80, -1, 1).astype(np.int32)
    maker = AtlasMaker(site.mesh, site.views, site, photographed(site, view), None, "png", 85)
    atlas = maker.make(rows, max_side=128)
    assert atlas.charts == 16
    assert (~np.isnan(atlas.gsd_m)).sum() == 16
