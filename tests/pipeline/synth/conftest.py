"""One quarry for all tests of this folder: making it takes a second."""

from __future__ import annotations

import pytest

from terraport_pipeline.synth.camera_eye import CameraEye
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import Quarry, synthesise


@pytest.fixture(scope="session")
def quarry() -> Quarry:
    return synthesise(QuarryOptions(points=60_000, seed=7))


@pytest.fixture(scope="session")
def clean_quarry() -> Quarry:
    """The same site measured by a perfect sensor."""
    options = QuarryOptions(
        points=60_000, seed=7, noise_m=0.0, colour_noise=0.0, outlier_fraction=0.0, holes=0,
        uneven=0.0,
    )  # fmt: skip
    return synthesise(options)


@pytest.fixture(scope="session")
def eye() -> CameraEye:
    """A camera's eye on a coarse truth mesh of a small site."""
    return CameraEye(QuarryOptions(points=1_000, seed=7, size_m=90.0, detail=1.0), 1.2, threads=2)
