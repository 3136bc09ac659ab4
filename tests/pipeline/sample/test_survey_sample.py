"""A bounded look at a survey's points, beside what a build measures of all of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pipeline.indexed_files import write_chunks
from pipeline.laz_files import Hill, las_data, write_tiles

from terraport_payload.types import Int64
from terraport_pipeline.errors import SurveyError
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.sample.survey_sample import SurveySample, sample_survey
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.survey.find_survey import find_survey

HILL = Hill(20_000)
SPACING_M = HILL.side_m / np.sqrt(len(HILL))


def _sample(path: Path, max_points: int = 5_000_000) -> SurveySample:
    survey, heads = find_survey(path).heads(NullProgress())
    return sample_survey(survey, heads, max_memory_bytes=4 << 30, max_points=max_points, threads=2)


def _strips(rows: int) -> list[Int64]:
    """Rows in the order of scan strips, cut into chunks: each lies close together."""
    place = HILL.millimetres[:, :2] / 1000
    strip = np.floor((place[:, 0] - place[:, 0].min()) / 4.0)
    order = np.lexsort([place[:, 1], strip])
    return np.split(order, np.arange(rows, len(order), rows))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The hill in strips, and in no order; chunks of 200 points."""
    folder = tmp_path_factory.mktemp("samples")
    las = las_data(HILL)
    write_chunks(folder / "strips.laz", las, _strips(200))
    rows = np.random.default_rng(4).permutation(len(HILL))
    write_chunks(folder / "anyhow.laz", las, np.split(rows, len(rows) // 200))
    return folder


@pytest.fixture(scope="module")
def whole(folder: Path) -> SurveySample:
    return _sample(folder / "strips.laz")


def test_a_small_survey_is_read_whole_and_measured_as_a_build_does(whole: SurveySample) -> None:
    assert (whole.whole, whole.read, whole.points) == (True, len(HILL), len(HILL))
    assert whole.measured["surface_spacing_m"] == pytest.approx(SPACING_M, rel=0.1)
    assert whole.measured["noise_m"] == pytest.approx(0.01, abs=0.02)
    assert whole.ground_m2 == pytest.approx(HILL.side_m**2, rel=0.1)
    assert whole.local_share == 1.0
    assert whole.density.counts.sum() == len(HILL)
    assert whole.ground.points == len(HILL)
    assert whole.ground.row_bytes == 24 + 3 + 1 + 4
    assert whole.ground.attributes == 2


def test_values_of_every_point(whole: SurveySample) -> None:
    columns = {column.name: column for column in whole.attributes}
    classes = columns["classification"]
    counted = {str(code): int((HILL.classes == code).sum()) for code in (2, 6)}
    assert (classes.low, classes.high, classes.values) == (2.0, 6.0, counted)
    grade = columns["grade"]
    assert grade.values is None
    assert (grade.low, grade.high) == (HILL.grade.min(), HILL.grade.max())
    assert whole.colours is not None
    assert whole.colours.depths == ("sixteen",)
    assert whole.colours.distinct == len(np.unique(HILL.colours // 257, axis=0))


@pytest.mark.parametrize("name", ["strips.laz", "anyhow.laz"])
def test_a_sample_tells_the_whole_whatever_the_order(
    folder: Path, whole: SurveySample, name: str
) -> None:
    some = _sample(folder / name, 4000)
    assert not some.whole
    assert some.points == len(HILL)
    assert some.read == pytest.approx(4000, rel=0.05)
    measured, expected = some.measured["surface_spacing_m"], whole.measured["surface_spacing_m"]
    assert measured == pytest.approx(expected, rel=0.15)
    assert some.ground_m2 == pytest.approx(HILL.side_m**2, rel=0.2)
    # Pieces lie nearly as dense as the whole, points in any order a fifth as dense.
    if name == "strips.laz":
        assert some.local_share > 0.5
    else:
        assert some.local_share == pytest.approx(0.2, rel=0.1)
    assert int(some.ground.plan.points.sum()) >= 0.9 * len(HILL)


def test_files_of_a_delivery_are_read_in_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("terraport_pipeline.sample.chosen_files.MAX_FILES", 5)
    write_tiles(tmp_path, HILL, tiles=3)
    some = _sample(tmp_path, 10_000)
    assert some.files == 5
    assert some.points == pytest.approx(len(HILL), abs=5)
    assert some.read < 0.7 * len(HILL)
    assert some.ground_m2 == pytest.approx(HILL.side_m**2, rel=0.25)


def test_text_is_counted_by_the_lines_that_were_read(tmp_path: Path) -> None:
    place = np.tile(HILL.millimetres / 1000, (3, 1)) + np.repeat(
        [[0, 0, 0], [40, 0, 0], [80, 0, 0]], len(HILL), 0
    )
    np.savetxt(tmp_path / "a.xyz", place, fmt="%.3f")
    some = _sample(tmp_path / "a.xyz", 20_000)
    assert not some.whole
    assert some.points == pytest.approx(3 * len(HILL), rel=0.05)


def test_copies_and_points_twice_are_counted(tmp_path: Path) -> None:
    las = las_data(HILL, np.arange(1000))
    rows = np.concatenate([np.arange(1000), np.arange(100)])
    again = las[rows]
    again.classification[1050:] = 9
    again.write(tmp_path / "a.laz")
    made = _sample(tmp_path / "a.laz")
    assert (made.repeats, made.copies) == (50, 50)
    assert (made.read, made.points) == (1100, 1100)
    assert made.ground.points == 1050


def test_gaps_within_the_survey_are_found(tmp_path: Path) -> None:
    place = HILL.millimetres[:, :2] / 1000 - [641_200, 8_594_700]
    rows = np.flatnonzero(((place - 20.0) ** 2).sum(axis=1) > 25.0)
    las_data(HILL, rows).write(tmp_path / "a.laz")
    made = _sample(tmp_path / "a.laz")
    assert made.gaps[0].area_m2 == pytest.approx(25 * np.pi, rel=0.3)
    assert np.hypot(made.gaps[0].east - 641_220, made.gaps[0].north - 8_594_720) < 5


def test_what_a_build_refuses_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("1 2 3\n4 5 6\n")
    with pytest.raises(SurveyError, match="2 different points"):
        _sample(tmp_path / "a.xyz")


def test_nothing_stays_behind(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    _sample(folder / "strips.laz", 4000)
    assert list(tmp_path.iterdir()) == []


def test_points_are_those_that_a_build_reads(folder: Path, whole: SurveySample) -> None:
    survey = read_survey(folder / "strips.laz")
    assert np.array_equal(survey.points.min(axis=0), whole.low)
    assert np.array_equal(survey.points.max(axis=0), whole.high)
