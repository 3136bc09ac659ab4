from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from terraport_pipeline.geometry.clouds.carry import carry_values


@pytest.fixture
def samples() -> np.ndarray:
    return np.random.default_rng(1).uniform(0, 10, (400, 3))


def test_a_target_on_a_sample_takes_its_value(samples: np.ndarray) -> None:
    colours = np.random.default_rng(2).integers(0, 256, (400, 3)).astype(np.uint8)
    values = {"grade": np.random.default_rng(3).random(400).astype(np.float32)}
    got, out = carry_values(cKDTree(samples), colours, values, samples[:50])
    assert (got == colours[:50]).all()
    assert np.allclose(out["grade"], values["grade"][:50], atol=1e-6)


def test_a_linear_field_comes_back_close(samples: np.ndarray) -> None:
    values = {"x": samples[:, 0].astype(np.float32)}
    targets = np.random.default_rng(4).uniform(2, 8, (200, 3))
    _, out = carry_values(cKDTree(samples), np.zeros((400, 3), np.uint8), values, targets)
    assert np.abs(out["x"] - targets[:, 0]).mean() < 0.5


def test_values_stay_within_their_neighbours(samples: np.ndarray) -> None:
    values = {"v": np.where(np.arange(400) % 2, 1.0, 3.0).astype(np.float32)}
    targets = np.random.default_rng(5).uniform(0, 10, (500, 3))
    _, out = carry_values(cKDTree(samples), np.zeros((400, 3), np.uint8), values, targets)
    assert out["v"].min() >= 1.0
    assert out["v"].max() <= 3.0


def test_codes_are_never_mixed(samples: np.ndarray) -> None:
    values = {"classification": np.where(np.arange(400) % 2, 2.0, 6.0).astype(np.float32)}
    targets = np.random.default_rng(6).uniform(0, 10, (500, 3))
    tree = cKDTree(samples)
    _, out = carry_values(
        tree, np.zeros((400, 3), np.uint8), values, targets, codes=["classification"]
    )
    _, nearest = tree.query(targets)
    assert (out["classification"] == values["classification"][nearest]).all()


def test_unknown_values_do_not_count_and_stay_unknown_alone(samples: np.ndarray) -> None:
    values = np.full(400, np.nan, dtype=np.float32)
    values[:200] = 5.0
    targets = samples + 0.01
    _, out = carry_values(cKDTree(samples), np.zeros((400, 3), np.uint8), {"v": values}, targets)
    finite = ~np.isnan(out["v"])
    assert (out["v"][finite] == 5.0).all()
    assert 200 < finite.sum() < 400


def test_fewer_samples_than_k() -> None:
    tree = cKDTree(np.array([[0.0, 0, 0], [1, 0, 0]]))
    colours = np.array([[0, 0, 0], [200, 200, 200]], dtype=np.uint8)
    got, _ = carry_values(tree, colours, {}, np.array([[0.5, 0, 0]]))
    assert got.tolist() == [[100, 100, 100]]
