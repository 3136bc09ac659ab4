"""The density map as a picture."""

from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.clouds.density_map import DensityMap
from terraport_pipeline.report.density_picture import draw_density


def test_empty_is_white_thin_is_dark_and_dense_is_yellow() -> None:
    picture = draw_density(DensityMap(np.array([[0, 1], [10, 100]]), 0.0, 0.0, 1.0))
    assert picture.shape == (400, 400, 3)
    assert picture[0, 0].tolist() == [255, 255, 255]
    dark, dense = picture[0, -1].astype(int), picture[-1, -1].astype(int)
    assert dark.sum() < picture[-1, 0].astype(int).sum() < dense.sum()
    assert dense[0] > 200 > dense[2]


def test_one_density_and_none() -> None:
    same = draw_density(DensityMap(np.full((500, 3), 7), 0.0, 0.0, 1.0))
    assert same.shape == (500, 3, 3)
    assert len(np.unique(same.reshape(-1, 3), axis=0)) == 1
    assert (draw_density(DensityMap(np.zeros((2, 2), np.int64), 0.0, 0.0, 1.0)) == 255).all()
