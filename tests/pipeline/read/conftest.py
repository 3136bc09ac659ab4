"""A small coloured cloud with attributes, far from the origin as real surveys are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest


@dataclass(frozen=True)
class Sample:
    points: np.ndarray
    colours: np.ndarray
    grade: np.ndarray
    classes: np.ndarray


@pytest.fixture
def sample() -> Sample:
    rng = np.random.default_rng(4)
    ticks = rng.integers(0, 50_000, (500, 3))
    points = ticks * 0.001 + np.array([641_000.0, 8_594_000.0, 1_200.0])
    colours = rng.integers(1, 256, (500, 3)).astype(np.uint8)
    colours[0] = (255, 254, 1)
    grade = rng.uniform(0, 4, 500).astype(np.float32)
    return Sample(points, colours, grade, rng.integers(1, 7, 500).astype(np.uint8))
