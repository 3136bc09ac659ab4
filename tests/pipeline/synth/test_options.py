from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import option_fields
from terraport_pipeline.synth.options import QuarryOptions


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("points", 999), ("points", 10**9), ("seed", -1), ("size_m", 0.0), ("size_m", math.nan),
        ("noise_m", -0.1), ("outlier_fraction", 1.0), ("uneven", 1.0), ("shadows", 1.5),
        ("benches", 1), ("face_angle_deg", 90.0), ("northing_m", math.inf),
    ],
)  # fmt: skip
def test_out_of_range_is_refused_with_name_value_and_range(name: str, value: float) -> None:
    with pytest.raises(OptionError) as caught:
        QuarryOptions(**{name: value})
    [field] = [field for field in option_fields(QuarryOptions) if field.name == name]
    assert str(caught.value) == f"{field.stated(value)}; expected {field.option.range()}"


def test_benches_that_do_not_fit_are_refused() -> None:
    with pytest.raises(OptionError, match="8 benches of 15 m height"):
        QuarryOptions(benches=8, bench_height_m=15.0)


def test_json_round_trip(tmp_path: Path) -> None:
    options = QuarryOptions(points=1234, seed=5, size_m=100.0)
    path = tmp_path / "a.json"
    path.write_text(json.dumps(options.to_dict()))
    assert QuarryOptions.from_json(path) == options
    path.write_text('{"seed": 9}')
    assert QuarryOptions.from_json(path) == QuarryOptions(seed=9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "cannot be read as JSON"),
        ("[1]", "expected a JSON object"),
        ('{"sead": 1}', "unknown option sead"),
        ('{"seed": "1"}', "seed is '1', expected a number"),
        ('{"seed": true}', "seed is True, expected a number"),
        ('{"points": 2000.5}', "points is 2000.5, expected a whole number"),
    ],
)
def test_bad_json_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(OptionError) as caught:
        QuarryOptions.from_json(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_window_beside_the_site_is_refused() -> None:
    with pytest.raises(OptionError, match=r"middle is 200 m east.*at most 180 and 160 m"):
        QuarryOptions(window_m=10.0, window_east_m=200.0)
    assert QuarryOptions(window_m=36.0, size_m=180.0, window_north_m=40.0).surveyed == (
        0,
        80,
        36,
        36,
    )
