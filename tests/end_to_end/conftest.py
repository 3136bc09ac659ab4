"""A small quarry, built once by the command line, as a user would."""

from __future__ import annotations

import pytest
from command_line import Built, run_terraport


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """Make 60,000 points of the procedural quarry and build them."""
    root = tmp_path_factory.mktemp("end_to_end")
    survey = root / "quarry.laz"
    made = run_terraport("synth", "-o", survey, "--points", "60k", "--seed", "3")
    assert made.returncode == 0, made.stderr
    result = Built(survey, root / "scenes")
    done = run_terraport("build", survey, "-o", result.scene)
    assert done.returncode == 0, done.stderr
    return result
