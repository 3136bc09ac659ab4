"""The coarser level of a segment: the same border, fewer faces, colours and regions carried."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from server.grid_scene import SCALES, STEP_M, tile_mesh

from terraport_payload import SegmentMesh, Texture, decode_segment, encode_segment
from terraport_pipeline.engines.coarser import coarser, levels_of, odd_edges
from terraport_pipeline.engines.images import decode_image, encode_image
from terraport_store.validate_mesh import border_of


def rough(cells: int, seed: int) -> SegmentMesh:
    """A square of noise, with a hole and a face that touches itself at a point."""
    mesh = tile_mesh(0, 0, cells)
    rng = np.random.default_rng(seed)
    positions = mesh.positions.copy()
    positions[:, 1] += rng.normal(0, 0.2, len(positions)).astype(np.float32)
    faces = np.delete(mesh.faces, rng.integers(len(mesh.faces), size=3), axis=0)
    # A corner may have lost its only face: every vertex of a segment is used.
    used, corners = np.unique(faces, return_inverse=True)
    return SegmentMesh(
        positions[used],
        corners.reshape(-1, 3).astype(np.uint32),
        mesh.normals[used],
        mesh.colours[used],
        mesh.region_ids[used],
        {"grade": mesh.attributes["grade"][used]},
    )


def through_the_codec(mesh: SegmentMesh) -> SegmentMesh:
    return decode_segment(encode_segment(mesh, step_m=STEP_M, scales=SCALES), scales=SCALES)


@settings(max_examples=25)
@given(cells=st.integers(3, 40), seed=st.integers(0, 99), share=st.floats(0.01, 1.0))
def test_the_border_is_the_same_bit_for_bit_once_decoded(
    cells: int, seed: int, share: float
) -> None:
    mesh = rough(cells, seed)
    level = coarser(mesh, share)
    detail, coarse = through_the_codec(mesh), through_the_codec(level)
    np.testing.assert_array_equal(border_of(detail), border_of(coarse))
    low, high = detail.positions.min(axis=0), detail.positions.max(axis=0)
    assert (coarse.positions >= low).all()
    assert (coarse.positions <= high).all()
    assert len(level.faces) <= len(mesh.faces)


def test_a_level_has_about_the_share_of_faces_and_stays_near() -> None:
    mesh = tile_mesh(0, 0, 60)
    level = coarser(mesh, 0.2)
    assert len(level.faces) == pytest.approx(0.2 * len(mesh.faces), rel=0.05)
    assert float(np.abs(level.positions[:, 1] - 1.0).max()) <= 0.51


def test_colours_meet_at_the_border_and_are_averaged_inside() -> None:
    mesh = tile_mesh(0, 0, 40)
    chequered = np.where(np.arange(len(mesh.positions))[:, None] % 2, 255, 0)
    mesh = replace(mesh, colours=np.tile(chequered, (1, 3)).astype(np.uint8))
    level = coarser(mesh, 0.2)
    assert level.colours is not None
    assert mesh.colours is not None
    by_place = {p.tobytes(): c for p, c in zip(mesh.positions, mesh.colours, strict=True)}
    on_border = np.zeros(len(level.positions), np.bool_)
    on_border[odd_edges(level.faces.astype(np.int32))] = True
    for place, colour in zip(level.positions[on_border], level.colours[on_border], strict=True):
        np.testing.assert_array_equal(by_place[place.tobytes()], colour)
    assert abs(float(level.colours[~on_border].mean()) - 127.5) < 25


def test_each_face_has_one_region_of_the_segment() -> None:
    mesh = tile_mesh(0, 0, 30)
    level = coarser(replace(mesh, region_ids=(mesh.positions[:, 0] > 4).astype(np.uint16)), 0.2)
    assert level.region_ids is not None
    corners = level.region_ids[level.faces]
    assert (corners == corners[:, :1]).all()
    assert set(np.unique(level.region_ids)) == {0, 1}


def test_attributes_without_a_value_are_left_out_of_the_mean() -> None:
    mesh = tile_mesh(0, 0, 30)
    grade = np.full(len(mesh.positions), 2.0, np.float32)
    grade[::3] = np.nan
    values = coarser(replace(mesh, attributes={"grade": grade}), 0.2).attributes["grade"]
    assert np.nanmin(values) == np.nanmax(values) == 2.0


def test_a_texture_is_halved_and_its_places_stay() -> None:
    mesh = tile_mesh(0, 0, 30)
    image = np.zeros((64, 64, 3), np.uint8)
    image[:, :, 0] = np.arange(64) * 4
    texture = Texture.of(encode_image(image, "png", 80))
    uvs = (mesh.positions[:, [0, 2]] / 10).astype(np.float32)
    level = coarser(replace(mesh, colours=None, uvs=uvs, texture=texture), 0.2)
    assert level.texture is not None
    assert level.uvs is not None
    assert (level.texture.width, level.texture.height) == (32, 32)
    assert decode_image(level.texture.data)[0, :, 0].tolist() == [
        round(8 * x + 2) for x in range(32)
    ]
    off = np.abs(level.uvs - level.positions[:, [0, 2]] / 10)
    assert float(off.max()) < 0.1


def test_the_levels_begin_with_the_segment_itself() -> None:
    mesh = tile_mesh(0, 0, 10)
    assert list(levels_of(mesh, 1)) == [mesh]
    first, second = levels_of(mesh, 2)
    assert first is mesh
    assert len(second.faces) < len(mesh.faces)
