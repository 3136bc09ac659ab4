from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from terraport_pipeline.errors import OptionError, SurveyError
from terraport_pipeline.model import Survey, to_crs
from terraport_pipeline.stages import clean
from terraport_pipeline.stages.contract import Context

Hill = Callable[..., Survey]


def with_points(survey: Survey, points: np.ndarray) -> Survey:
    count = len(points)
    return replace(
        survey,
        points=points,
        colours=None if survey.colours is None else survey.colours[:count],
        attributes={name: values[:count] for name, values in survey.attributes.items()},
    )


def repeated(survey: Survey, rows: np.ndarray) -> Survey:
    return replace(
        survey,
        points=survey.points[rows],
        colours=None if survey.colours is None else survey.colours[rows],
        attributes={name: values[rows] for name, values in survey.attributes.items()},
    )


def test_points_come_back_in_utm_within_a_tenth_of_a_millimetre(
    hill: Hill, context: Context
) -> None:
    survey = hill()
    result = clean.run(survey, clean.Options(), context)
    back = to_crs(result.cloud.points, result.cloud.origin)
    assert len(back) == result.facts.counts["points"]
    distance_m, _ = cKDTree(survey.points - survey.points[0]).query(back - survey.points[0])
    assert distance_m.max() < 1e-4
    assert (result.cloud.origin == np.rint(result.cloud.origin)).all()
    assert result.cloud.points[:, 1].min() >= 0


def test_colours_and_attributes_stay_with_their_points(hill: Hill, context: Context) -> None:
    survey = repeated(hill(), np.r_[np.arange(3000), np.arange(100)])
    result = clean.run(survey, clean.Options(), context)
    east = to_crs(result.cloud.points, result.cloud.origin)[:, 0] - 641200.0
    red = result.cloud.colours[:, 0] == 200
    assert (red == (east > 0))[np.abs(east) > 0.1].all()
    assert np.abs(result.cloud.attributes["grade"] - (0.5 + east / 40)).max() < 0.002


def test_copies_are_dropped_and_counted(hill: Hill, context: Context) -> None:
    survey = repeated(hill(), np.r_[np.arange(3000), np.arange(0, 3000, 3)])
    counts = clean.run(survey, clean.Options(), context).facts.counts
    assert counts["points_read"] == 4000
    assert counts["duplicates"] == 1000
    assert counts["points"] + counts["outliers"] == 3000


def test_spacing_and_noise_are_measured(hill: Hill, context: Context) -> None:
    counts = clean.run(hill(12_000), clean.Options(), context).facts.counts
    assert counts["spacing_m"] == pytest.approx(40 / 12_000**0.5, rel=0.3)
    assert 0.003 < counts["noise_m"] < 0.05


def test_normals_are_unit_and_out_of_the_ground(hill: Hill, context: Context) -> None:
    cloud = clean.run(hill(), clean.Options(), context).cloud
    assert np.allclose(np.linalg.norm(cloud.normals, axis=1), 1.0, atol=1e-5)
    assert (cloud.normals[:, 1] > 0).mean() > 0.999


def test_whole_number_classes_are_codes_and_amounts_are_not(hill: Hill, context: Context) -> None:
    survey = hill()
    survey.attributes["gps_time"] = np.arange(3000) + 2.5e8
    survey.attributes["point_id"] = np.arange(3000) + 2**25
    survey.attributes["intensity"] = (np.arange(3000) * 17 % 60_000).astype(np.uint16)
    result = clean.run(survey, clean.Options(), context)
    assert result.codes == ("classification",)
    warnings = " ".join(result.facts.warnings)
    assert "'gps_time'" in warnings
    assert "'point_id' exceeds 2^24" in warnings
    assert "'intensity'" not in warnings
    assert "'grade'" not in warnings


def test_unknown_values_stay_unknown(hill: Hill, context: Context) -> None:
    survey = hill()
    survey.attributes["grade"][:700] = np.inf
    result = clean.run(survey, clean.Options(), context)
    assert np.isnan(result.cloud.attributes["grade"]).sum() in range(690, 701)


def test_a_grey_survey_is_grey_and_says_so(hill: Hill, context: Context) -> None:
    cloud = clean.run(hill(colours=False), clean.Options(), context).cloud
    assert not cloud.has_colour
    assert (cloud.colours == cloud.colours[0, 0]).all()


def test_the_result_does_not_depend_on_threads(hill: Hill, context: Context) -> None:
    results = [
        clean.run(hill(), clean.Options(), replace(context, threads=threads)) for threads in (1, 2)
    ]
    first, second = (clean.FORM.store(result).arrays for result in results)
    assert {n: a.tobytes() for n, a in first.items()} == {n: a.tobytes() for n, a in second.items()}


def test_stored_and_restored(hill: Hill, context: Context) -> None:
    result = clean.run(hill(), clean.Options(), context)
    back = clean.FORM.restore(clean.FORM.store(result), result.facts)
    assert (back.cloud.points == result.cloud.points).all()
    assert back.cloud.attributes.keys() == result.cloud.attributes.keys()
    assert back.codes == result.codes
    assert back.cloud.spacing_m == result.cloud.spacing_m


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.eye(3) * 7, "3 different points"),
        (np.ones((500, 3)), r"1 different points \(of 500 read\)"),
        (np.outer(np.arange(200.0), [1, 2, 3]), "lie on one line"),
        (np.random.default_rng(1).uniform(0, 9, (300, 3)) * [1, 1, 0], "lie on one plane"),
        (
            np.random.default_rng(1).uniform(0, 9, (300, 2)) @ np.array([[1.0, 2, 3], [3, -1, 1]]),
            "lie on one plane",
        ),
    ],
    ids=["three", "copies", "line", "level plane", "tilted plane"],
)
def test_what_is_no_surface_is_refused(
    hill: Hill, context: Context, points: np.ndarray, message: str
) -> None:
    survey = with_points(hill(), points + np.array([641200.0, 8594700.0, 1287.0]))
    with pytest.raises(SurveyError, match=message):
        clean.run(survey, clean.Options(), context)


def test_numbers_that_are_none_are_refused_with_their_place(hill: Hill, context: Context) -> None:
    survey = hill()
    survey.points[[17, 80], 2] = np.nan
    with pytest.raises(SurveyError, match=r"2 of 3000 points .* the first is point 17"):
        clean.run(survey, clean.Options(), context)


@pytest.mark.parametrize(
    "options", [{"outlier_ratio": 1.0}, {"outlier_ratio": float("nan")}, {"normal_neighbours": 3}]
)
def test_options_out_of_range(options: dict[str, float]) -> None:
    with pytest.raises(OptionError, match="expected"):
        clean.Options(**options)  # type: ignore[arg-type]
