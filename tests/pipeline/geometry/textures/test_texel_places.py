from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.textures.texel_places import texel_places

SQUARE = np.array([[[0, 0], [32, 0], [0, 32]], [[32, 0], [32, 32], [0, 32]]], dtype=float)
"""A square of 32 texels as two faces."""
BOTH = np.arange(2, dtype=np.int32)


def surface(texels: np.ndarray) -> np.ndarray:
    """Corners on a tilted plane: a texel is half a metre wide."""
    x, z = texels[..., 0] * 0.5, texels[..., 1] * 0.5
    return np.stack([x, 2.0 * x - z, z], axis=-1)


def test_every_texel_has_the_place_of_its_centre() -> None:
    covered = np.zeros((32, 32), np.uint8)
    texel, place = texel_places(covered, SQUARE, surface(SQUARE), BOTH)
    assert covered.all()
    assert len(texel) == 32 * 32
    np.testing.assert_allclose(place, surface(texel[:, ::-1] + 0.5), atol=1e-5)


def test_a_margin_goes_on_in_the_plane_where_nothing_is() -> None:
    covered = np.zeros((40, 40), np.uint8)
    inside = np.add(SQUARE, 4.0)
    texel_places(covered, inside, surface(inside), BOTH)
    texel, place = texel_places(covered, inside, surface(inside), BOTH, margin=1.5)
    rows, columns = texel.T
    assert ((rows < 4) | (rows >= 36) | (columns < 4) | (columns >= 36)).all()
    assert (3, 10) in set(map(tuple, texel.tolist()))
    np.testing.assert_allclose(place, surface(texel[:, ::-1] + 0.5), atol=1e-4)


def test_a_face_smaller_than_a_texel_takes_a_free_one() -> None:
    covered = np.zeros((4, 4), np.uint8)
    small = np.array([[[1.6, 1.6], [1.8, 1.6], [1.6, 1.8]]])
    points = np.array([[[7.0, 8.0, 9.0]] * 3])
    texel, place = texel_places(covered, small, points, np.array([0], np.int32))
    assert texel.tolist() == [[1, 1]]
    np.testing.assert_allclose(place, [[7.0, 8.0, 9.0]])
    again, _ = texel_places(covered, small, points, np.array([0], np.int32))
    assert len(again) == 0


def test_a_sliver_does_not_lead_far_away() -> None:
    covered = np.zeros((16, 16), np.uint8)
    sliver = np.array([[[2.0, 8.0], [14.0, 8.0], [8.0, 8.0001]]])
    points = np.array([[[0.0, 0.0, 0.0], [12.0, 0.0, 0.0], [6.0, 50.0, 0.0]]])
    _, place = texel_places(covered, sliver, points, np.array([0], np.int32), margin=1.5)
    assert len(place)
    assert np.abs(place).max() <= 100.0
