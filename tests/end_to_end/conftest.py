"""A small quarry, built once by the command line, as a user would.

Without the report, whose pictures take longer than all the rest: one test builds with it.
"""

from __future__ import annotations

from typing import Final

import pytest
from command_line import Built, run_terraport

BUILD: Final = ("--no-report", "--max-extent-m", "80")


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """Make 20,000 points of the procedural quarry and build them in some dozens of segments."""
    root = tmp_path_factory.mktemp("end_to_end")
    survey = root / "quarry.laz"
    synth_run = run_terraport("synth", "-o", survey, "--points", "20k", "--seed", "3")
    assert synth_run.returncode == 0, synth_run.stderr
    result = Built(survey, root / "scenes")
    done = run_terraport("build", survey, "-o", result.scene, *BUILD)
    assert done.returncode == 0, done.stderr
    return result
