"""Levelling and atlases of tiles: both sides of a border come out alike."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from memory_tiles import MemoryTiles
from tiled_place import chosen, context, gains, one_segment, opened, scale, site, tiles

from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.geometry.photos.photo_samples import neutral_gains
from terraport_pipeline.geometry.photos.view_choice import ViewChoice
from terraport_pipeline.stages.texture import Options
from terraport_pipeline.stages.texture_sums import TextureTally
from terraport_pipeline.stages.tiles import tiled_texture, tiled_views


@cache
def levels(along: int) -> tiled_texture.Levels:
    return tiled_texture.solve(
        [
            tiled_texture.level(
                tiles(along), tile, chosen(along), gains(), scale(), context()
            ).arrays
            for tile in range(along * along)
        ]
    )


def finished(along: int, monkeypatch, tmp_path) -> list[ViewChoice]:
    """What every tile hands to the drawing of its atlases."""
    choices: list[ViewChoice] = []

    def noted(mesh, pieces, views, photos, choice, *arguments, **named):
        choices.append(choice)
        return whole(mesh, pieces, views, photos, choice, *arguments, **named)

    whole = tiled_texture.texture_mesh
    monkeypatch.setattr(tiled_texture, "texture_mesh", noted)
    for tile in range(along * along):
        segments = np.zeros(tiles(along).face_count(tile), np.int32)
        tiled_texture.draw(
            tiles(along), tile, segments, chosen(along), levels(along), opened(), gains(),
            scale(), Options(texel_m=0.3), context(tmp_path),
        )  # fmt: skip
    return choices


def test_both_sides_of_a_border_are_corrected_alike(monkeypatch, tmp_path) -> None:
    choices = finished(2, monkeypatch, tmp_path)
    corrections: dict[tuple[int, int], list[np.ndarray]] = {}
    tiled = tiles(2)
    for tile, choice in enumerate(choices):
        faces, shared = tiled.meshes[tile].faces, tiled.shared[tiled.numbers[tile]]
        seen = {}
        for face, corner in zip(*np.nonzero(shared[faces]), strict=True):
            number = int(tiled.numbers[tile][faces[face, corner]])
            seen[number, int(choice.view[face])] = choice.correction[face, corner]
        for key, value in seen.items():
            corrections.setdefault(key, []).append(value.astype(np.float64))
    both = [values for values in corrections.values() if len(values) > 1]
    assert len(both) > 40
    apart = np.array([np.ptp(values, axis=0).max() for values in both])
    assert apart.max() < 0.1  # of 255 levels
    assert np.abs([values[0] for values in both]).max() > 0.2


def test_steps_across_borders_are_not_larger_than_within(monkeypatch, tmp_path) -> None:
    steps = []
    for tile in range(4):
        segments = np.zeros(tiles(2).face_count(tile), np.int32)
        steps.append(
            tiled_texture.draw(
                tiles(2), tile, segments, chosen(2), levels(2), opened(), gains(), scale(),
                Options(texel_m=0.3), context(tmp_path),
            ).arrays
        )  # fmt: skip
    middles = (np.arange(tiled_texture.STEP_BINS) + 0.5) / 4
    weights = sum(arrays["steps_local"] for arrays in steps)
    means = (weights * middles).sum(axis=1) / weights.sum(axis=1)
    assert means[1] < max(1.3 * means[0], 1.5)
    edges = sum(arrays["steps_edges"] for arrays in steps)
    assert edges[:, 0].sum() == pytest.approx(
        len(face_pairs(site().mesh.faces, len(site().mesh.vertices))[0])
    )


def test_a_tile_that_no_photo_sees_keeps_the_clouds_colours(tmp_path) -> None:
    view = site().views[0]
    away = View(view.name, view.lens, view.rotation, view.position + np.array([0.0, 0.0, 1e4]))
    blind = OpenPhotos((away,), site(), ())  # type: ignore[arg-type]
    gains_of = neutral_gains(1)
    single = MemoryTiles.of(site().mesh, 1)
    choice = tiled_views.choose(
        single, 0, site().mesh, blind, gains_of, scale(), one_segment(single, 0), context()
    ).arrays
    assert (choice["view"] == -1).all()
    cells = tiled_texture.level(single, 0, [choice], gains_of, scale(), context()).arrays
    solution = tiled_texture.solve([cells])
    assert not solution.level.any()
    segments = np.zeros(single.face_count(0), np.int32)
    drawn = tiled_texture.draw(
        single, 0, segments, [choice], solution, blind, gains_of, scale(), Options(texel_m=0.5),
        context(tmp_path),
    )  # fmt: skip
    assert TextureTally.total([drawn.arrays]).facts()["unseen_share"] == 1.0
    assert len(tiled_texture.tile_textures(drawn.arrays).images) > 0
