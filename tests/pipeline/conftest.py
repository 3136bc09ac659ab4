"""Small surveys for the tests of the build, made by seeded functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from terraport_payload.types import Float32, Float64, Int64, UInt8
from terraport_pipeline.model import Crs, Survey
from terraport_pipeline.stages.contract import Context

ORIGIN = np.array([641200.0, 8594700.0, 1287.0])
"""UTM 35 S: float32 steps here are half a metre."""


@dataclass(frozen=True)
class Overhang:
    """A rock shelf over a recess, sampled at random, with the true normals. Scene frame."""

    points: Float32
    normals: Float64
    edge: Int64
    """0 ground, 1 back wall of the recess, 2 underside, 3 face, 4 top."""


def relief(east: Float64, north: Float64) -> Float64:
    """Height of the hill at a place, metres: smooth, with slopes up to 45 degrees."""
    return 6.0 * np.sin(east / 9.0) * np.cos(north / 11.0) + 0.05 * east


def hill_survey(
    count: int = 3000, *, seed: int = 3, side_m: float = 40.0, colours: bool = True
) -> Survey:
    """A coloured hill with a smooth attribute and a class code, in UTM."""
    rng = np.random.default_rng(seed)
    east, north = rng.uniform(-side_m / 2, side_m / 2, (2, count))
    points = np.stack([east, north, relief(east, north)], axis=1)
    points += rng.normal(0.0, 0.01, points.shape)
    rgb: UInt8 = np.where((east > 0)[:, None], (200, 60, 40), (60, 120, 50)).astype(np.uint8)
    return Survey(
        points=points + ORIGIN,
        colours=rgb if colours else None,
        attributes={
            "grade": (0.5 + east / side_m).astype(np.float32),
            "classification": np.where(north > 0, 2, 6).astype(np.uint8),
        },
        crs=Crs("WGS 84 / UTM zone 35S", "PROJCS[...]", 32735),
        format="xyz",
    )


@pytest.fixture
def hill() -> Callable[..., Survey]:
    """The maker of hill surveys: a test chooses size, seed and whether there are colours."""
    return hill_survey


@pytest.fixture(scope="session")
def make_hill() -> Callable[..., Survey]:
    """Make a hill survey; for fixtures of a wider scope."""
    return hill_survey


@pytest.fixture
def context(tmp_path: Path) -> Context:
    """One thread, silent, scratch files under the test's folder."""
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    return Context(scratch)


@pytest.fixture(scope="session")
def overhang() -> Overhang:
    """A profile through ground, recess, underside, face and top, drawn along z."""
    rng = np.random.default_rng(0)
    profile = np.array([[-12, 0], [3, 0], [3.4, 3], [0, 4], [0, 8], [12, 8.0]])
    steps = np.diff(profile, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    along = rng.uniform(0, starts[-1], 20_000)
    edge = np.searchsorted(starts, along, side="right") - 1
    share = (along - starts[edge]) / lengths[edge]
    xy = profile[edge] + steps[edge] * share[:, None]
    points = np.column_stack([xy, rng.uniform(0, 15, len(xy))]) + rng.normal(0, 0.01, (len(xy), 3))
    outward = np.stack([-steps[:, 1], steps[:, 0], np.zeros(len(steps))], axis=1)
    return Overhang(points.astype(np.float32), (outward / lengths[:, None])[edge], edge)


def survey_text(survey: Survey) -> str:
    """Write a survey as an XYZ file with a header line."""
    assert survey.colours is not None
    rows = [
        f"{x:.4f} {y:.4f} {z:.4f} {r} {g} {b} {grade:.6f}"
        for (x, y, z), (r, g, b), grade in zip(
            survey.points, survey.colours, survey.attributes["grade"], strict=True
        )
    ]
    return "\n".join(["x y z red green blue grade", *rows, ""])


@pytest.fixture
def hill_file(tmp_path: Path) -> Path:
    """A hill of 3,000 points as an XYZ file."""
    path = tmp_path / "hill.xyz"
    path.write_text(survey_text(hill_survey()), encoding="ascii")
    return path


@pytest.fixture(scope="session")
def make_hill_text() -> str:
    """A hill of 3,000 points as the text of an XYZ file."""
    return survey_text(hill_survey())
