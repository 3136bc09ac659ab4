from __future__ import annotations

import numpy as np

from terraport_pipeline.synth.noise import Noise


def fields(seed: int = 0) -> Noise:
    return Noise(np.random.default_rng(seed))


def test_bounded_centred_and_deterministic() -> None:
    x, y = np.random.default_rng(1).uniform(-500, 500, (2, 50_000))
    first = fields()(x, y, wavelength=7.0, octaves=5)
    np.testing.assert_array_equal(first, fields()(x, y, wavelength=7.0, octaves=5))
    assert np.abs(first).max() <= 1.0
    assert abs(first.mean()) < 0.05
    assert first.std() > 0.15


def test_smooth_a_step_of_a_thousandth_changes_little() -> None:
    x = np.linspace(-100, 100, 20_000)
    y = 0.37 * x
    here = fields()(x, y, wavelength=10.0)
    stepped = fields()(x + 0.01, y, wavelength=10.0)
    # Value noise changes by at most 2 x 1.875 per wavelength.
    assert np.abs(stepped - here).max() < 0.01 / 10.0 * 3.75 + 1e-9


def test_fields_are_unrelated() -> None:
    x, y = np.random.default_rng(1).uniform(-500, 500, (2, 20_000))
    first = fields()(x, y, wavelength=7.0, field=1)
    second = fields()(x, y, wavelength=7.0, field=2)
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.05
