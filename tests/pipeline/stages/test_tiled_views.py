"""Photos on tiles against photos on the whole: the same place, cut into four."""

from __future__ import annotations

import numpy as np
import pytest
from memory_tiles import MemoryTiles
from tiled_place import chosen, context, gains, one_segment, opened, scale, site, tiles

from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages.tiles import tiled_views


def views_of(along: int) -> np.ndarray:
    """View of every face of the whole mesh."""
    view = np.full(len(site().mesh.faces), -9, np.int64)
    for rows, arrays in zip(tiles(along).rows, chosen(along), strict=True):
        view[rows] = arrays["view"]
    return view


def test_tiles_choose_as_the_whole_does() -> None:
    whole, cut = views_of(1), views_of(2)
    assert (whole != cut).mean() < 0.1
    pairs, _ = face_pairs(site().mesh.faces, len(site().mesh.vertices))
    tile = np.empty(len(whole), np.int64)
    for number, rows in enumerate(tiles(2).rows):
        tile[rows] = number
    across = tile[pairs[:, 0]] != tile[pairs[:, 1]]
    parted = (cut[pairs[:, 0]] != cut[pairs[:, 1]])[across].mean()
    assert parted < 0.25


def test_what_lies_beyond_the_band_hides_what_is_behind_it() -> None:
    # the block of the place hides ground from some cameras; far from it stands the base for it
    mesh = site().mesh
    only = Mesh(mesh.vertices, mesh.faces[:0], mesh.normals, mesh.colours)
    cut_tiles = MemoryTiles.of(mesh, 4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tiled_views, "_BAND_EDGES", 1.0)
        counts = []
        for base in (mesh, only):
            views = [
                tiled_views.choose(
                    cut_tiles,
                    tile,
                    base,
                    opened(),
                    gains(),
                    scale(),
                    one_segment(cut_tiles, tile),
                    context(),
                ).arrays["candidate_view"]
                for tile in range(16)
            ]
            counts.append(sum(int((view >= 0).sum()) for view in views))
    whole = int((chosen(1)[0]["candidate_view"] >= 0).sum())
    assert counts[0] < counts[1]
    assert abs(counts[0] - whole) < 0.02 * whole


def test_charts_end_at_segments() -> None:
    """A segment of a hundred faces gets one photo, though its surroundings go on beyond it."""
    middle = site().mesh.vertices[site().mesh.faces].mean(axis=1)[:, [0, 2]]
    whole = views_of(1)
    across = np.flatnonzero(whole >= 0)
    pairs, _ = face_pairs(site().mesh.faces, len(site().mesh.vertices))
    seam = pairs[(whole[pairs] >= 0).all(axis=1) & (whole[pairs[:, 0]] != whole[pairs[:, 1]])]
    around = np.bincount(seam[:, 0], minlength=len(whole))[across]
    at = middle[across[np.argmax(around)]]
    segments = (np.abs(middle - at).max(axis=1) < 2.0).astype(np.int32)
    assert len(np.unique(whole[segments == 1])) > 1
    choice = tiled_views.choose(
        tiles(1), 0, site().mesh, opened(), gains(), scale(), segments, context()
    ).arrays["view"]
    within = pairs[(segments[pairs] == 1).all(axis=1)]

    def charts(view: np.ndarray) -> int:
        own = segments == 1
        return len(
            np.unique(components(len(view), within, labels=view.astype(np.int32) + 1)[0][own])
        )

    assert charts(choice) < charts(whole)
