"""The sample in data/ is what its parameters make."""

from __future__ import annotations

import hashlib
from pathlib import Path

import laspy
import numpy as np

from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import synthesise

DATA = Path(__file__).resolve().parents[3] / "data"


def test_the_checksums_are_those_of_the_files() -> None:
    for line in (DATA / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split()
        assert hashlib.sha256((DATA / name).read_bytes()).hexdigest() == digest, name


def test_the_cloud_is_what_the_parameters_make() -> None:
    survey = synthesise(QuarryOptions.from_json(DATA / "sample_quarry.json")).survey
    las = laspy.read(DATA / "sample_quarry_60k.laz")
    step_m = np.max(las.header.scales)
    # Two steps and one level: the last bit of sin and exp differs between processors.
    np.testing.assert_allclose(np.asarray(las.xyz), survey.points, rtol=0, atol=2 * step_m)
    assert survey.colours is not None
    stored = np.stack([las.red, las.green, las.blue], axis=1) >> 8
    np.testing.assert_allclose(stored, survey.colours, rtol=0, atol=1)
    np.testing.assert_allclose(las["grade"], survey.attributes["grade"], rtol=1e-5)
