"""The cover by tiles against the cover of the whole."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from coloured_ground import cut_mesh, ground

from terraport_pipeline.geometry.cover.cover import build_cover
from terraport_pipeline.geometry.tiles.tiled_cover import (
    cover_reach_m,
    near_faces,
    tile_cover,
    unite_covers,
)
from terraport_pipeline.stages.tiles.detail_tiles import vertex_box


def test_every_base_face_lists_what_the_whole_lists() -> None:
    base, detail = ground(10, low=-2.0, high=62.0), ground(48)
    pieces = cut_mesh(detail, 3)
    segment = np.empty(len(detail.faces), np.int64)
    covers, first = [], 0
    for piece, rows in pieces:
        own = (np.arange(len(rows)) * 3 // len(rows)).astype(np.int32)
        segment[rows] = own + first
        reach_m = cover_reach_m(0.5, 6.4, 1.3)
        near = near_faces(base.vertices, base.faces, vertex_box(piece.vertices), reach_m)
        cover = tile_cover(
            base.vertices, base.faces[near], piece.vertices, piece.faces, own, tolerance_m=0.5
        )
        assert cover.baseless_faces == 0
        covers.append((near[cover.base_face].astype(np.int32), cover.segment + np.int32(first)))
        first += 3
    offsets, segments = unite_covers(covers, len(base.faces))
    whole = build_cover(
        base.vertices, base.faces, detail.vertices, detail.faces, segment,
        tolerance_m=0.5, hide_partly_covered=True,
    )  # fmt: skip
    assert len(offsets) == len(base.faces) + 1
    lists = [set(segments[a:b].tolist()) for a, b in pairwise(offsets)]
    expected = [set(whole.segments[a:b].tolist()) for a, b in pairwise(whole.offsets)]
    # Grids lie elsewhere, so lists at the rim of a segment may differ by a cell's breadth; what
    # lies over the base face's own inside is in both.
    differing = sum(a != b for a, b in zip(lists, expected, strict=True))
    assert differing < 0.15 * len(lists)
    assert (
        sum(len(a - b) + len(b - a) for a, b in zip(lists, expected, strict=True)) <= 2 * differing
    )
    assert all((np.diff(segments[a:b].astype(int)) > 0).all() for a, b in pairwise(offsets))


def test_no_tile_gives_empty_lists() -> None:
    offsets, segments = unite_covers([], 4)
    assert offsets.tolist() == [0, 0, 0, 0, 0]
    assert len(segments) == 0


def test_the_base_near_a_tile_is_what_its_box_comes_near() -> None:
    base = ground(10, low=0.0, high=100.0)
    near = near_faces(base.vertices, base.faces, np.array([0, 0, 0, 5.0, 9, 95]), 14.0)
    x = base.vertices[base.faces][:, :, 0].min(axis=1)
    assert near.tolist() == np.flatnonzero(x <= 19.0).tolist()
