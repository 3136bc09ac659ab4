from __future__ import annotations

from pathlib import Path

import numpy as np
import pye57
import pytest
from pipeline.e57_files import colour_limits, write_e57
from pipeline.read.read_in_order import read_in_order

from terraport_pipeline.errors import ReadError
from terraport_pipeline.stages.read import read_survey

OFFSET = np.array([641_000.0, 8_594_000.0, 1_200.0])
HALF_TURN = np.array([np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])
"""Quaternion (w, x, y, z) of a quarter turn to the left about the vertical."""


def fields(sample, rows: slice, *, colours=True) -> dict[str, np.ndarray]:
    local = (sample.points - OFFSET).astype(np.float32).astype(np.float64)[rows]
    data = {f"cartesian{axis}": local[:, k].copy() for k, axis in enumerate("XYZ")}
    data["intensity"] = sample.grade[rows]
    if colours:
        for k, name in enumerate(("Red", "Green", "Blue")):
            data[f"color{name}"] = sample.colours[rows, k]
    return data


def write(path: Path, sample) -> Path:
    """Write two scans: one shifted, one shifted and turned."""
    with pye57.E57(str(path), mode="w") as file:
        file.write_scan_raw(fields(sample, slice(0, 300)), translation=OFFSET)
        file.write_scan_raw(fields(sample, slice(300, 500)), rotation=HALF_TURN, translation=OFFSET)
    return path


def test_all_scans_with_their_poses(tmp_path, sample) -> None:
    local = (sample.points - OFFSET).astype(np.float32).astype(np.float64)
    turned = np.stack([-local[300:, 1], local[300:, 0], local[300:, 2]], axis=1)
    written = np.concatenate([local[:300], turned]) + OFFSET
    survey = read_in_order(write(tmp_path / "a.e57", sample), written)
    np.testing.assert_allclose(survey.points, written, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    np.testing.assert_allclose(survey.attributes["intensity"], sample.grade, rtol=1e-6)
    np.testing.assert_array_equal(survey.attributes["scan"], np.arange(500) >= 300)


def test_points_marked_invalid_are_left_out_and_counted(tmp_path, sample) -> None:
    valid = np.arange(500) % 5 != 0
    data = fields(sample, slice(0, 500))
    data["cartesianInvalidState"] = (~valid).astype(np.int8)
    path = tmp_path / "a.e57"
    with pye57.E57(str(path), mode="w") as file:
        file.write_scan_raw(data)
    survey = read_in_order(path, (sample.points - OFFSET)[valid])
    np.testing.assert_array_equal(survey.colours, sample.colours[valid])
    assert survey.warnings == ("100 points that the scanner marked invalid were left out.",)


def test_a_scan_without_colour_beside_one_with(tmp_path, sample) -> None:
    path = tmp_path / "a.e57"
    with pye57.E57(str(path), mode="w") as file:
        file.write_scan_raw(fields(sample, slice(0, 300)))
        file.write_scan_raw(fields(sample, slice(300, 500), colours=False))
    survey = read_in_order(path, sample.points - OFFSET)
    assert survey.colours is not None
    np.testing.assert_array_equal(survey.colours[:300], sample.colours[:300])
    assert (survey.colours[300:] == 160).all()
    assert "There is no colour in scan 1: its points are grey." in survey.warnings
    assert any("200 of 500 points have no colour" in text for text in survey.warnings)


def test_coordinates_too_large_for_32_bits_are_named(tmp_path, sample) -> None:
    data = fields(sample, slice(0, 500))
    data["cartesianY"] = data["cartesianY"] + OFFSET[1]  # pye57 writes 32-bit floats
    path = tmp_path / "a.e57"
    with pye57.E57(str(path), mode="w") as file:
        file.write_scan_raw(data)
    for share in (1.0, 0.5):  # a sample ends before the stream does
        assert "steps of 1 m" in read_survey(path, share=share).warnings[0]


def test_no_scan_is_an_error(tmp_path) -> None:
    path = tmp_path / "a.e57"
    with pye57.E57(str(path), mode="w"):
        pass
    with pytest.raises(ReadError, match="0 scans with 0 points"):
        read_survey(path)


def test_damage_is_a_read_error_and_the_file_stays(tmp_path, sample) -> None:
    path = write(tmp_path / "a.e57", sample)
    data = path.read_bytes()
    for length in range(8, len(data) - 1, 2003):
        path.write_bytes(data[:length])
        with pytest.raises(ReadError):
            read_survey(path)
        assert path.exists()
    spoilt = bytearray(data)
    spoilt[1500] ^= 0xFF  # within the second page: its checksum no longer fits
    path.write_bytes(spoilt)
    with pytest.raises(ReadError):
        read_survey(path)


def columns(sample, rows=slice(None), factor: float = 1.0, **others) -> dict[str, np.ndarray]:
    """Cartesian coordinates in 64 bits, and colours times a factor."""
    local = sample.points[rows] - OFFSET
    names = ("Red", "Green", "Blue")
    colours = sample.colours[rows].astype(np.int64) * (factor if factor < 1 else int(factor))
    return (
        {f"cartesian{axis}": local[:, k] for k, axis in enumerate("XYZ")}
        | {f"color{name}": colours[:, k] for k, name in enumerate(names)}
        | others
    )


def test_colours_of_each_scan_by_its_limits_or_its_values(tmp_path, sample) -> None:
    parts = np.array_split(np.arange(500), 5)
    scans = [
        {"columns": columns(sample, parts[0]), "colorLimits": colour_limits(0, 255)},
        {"columns": columns(sample, parts[1], 257), "colorLimits": colour_limits(0, 65535)},
        {"columns": columns(sample, parts[2], 4), "colorLimits": colour_limits(0, 1020)},
        {"columns": columns(sample, parts[3], 1 / 255)},  # floats, no limits
        {"columns": columns(sample, parts[4])},
    ]
    survey = read_in_order(write_e57(tmp_path / "a.e57", scans), sample.points - OFFSET)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    assert survey.warnings == ()


def test_limits_that_are_no_depth_are_not_used(tmp_path, sample) -> None:
    """Those of what the channels hold, the wrong ones, and none at all."""
    held = {}
    for k, channel in enumerate(("Red", "Green", "Blue")):
        held[f"color{channel}Minimum"] = 10 * k
        held[f"color{channel}Maximum"] = 200 + 10 * k
    for number, limits in enumerate((held, colour_limits(0, 65535), colour_limits(0, 0), {})):
        scan = {"columns": columns(sample), "colorLimits": limits}
        path = write_e57(tmp_path / f"{number}.e57", [scan])
        survey = read_in_order(path, sample.points - OFFSET)
        np.testing.assert_array_equal(survey.colours, sample.colours)
        assert bool(survey.warnings) == (number == 1)


def test_values_marked_invalid_are_no_values(tmp_path, sample) -> None:
    bad = np.arange(500) % 4 == 1
    flagged = columns(sample, intensity=sample.grade.astype(np.float64))
    for name in ("colorRed", "colorGreen", "colorBlue", "intensity"):
        flagged[name] = np.where(bad, 0, flagged[name])
    flagged["isColorInvalid"] = bad.astype(np.uint8)
    flagged["isIntensityInvalid"] = np.roll(bad, 1).astype(np.uint8)
    path = write_e57(tmp_path / "a.e57", [{"columns": flagged}])
    survey = read_in_order(path, sample.points - OFFSET)
    assert (survey.colours[bad] == 160).all()
    np.testing.assert_array_equal(survey.colours[~bad], sample.colours[~bad])
    np.testing.assert_array_equal(np.isnan(survey.attributes["intensity"]), np.roll(bad, 1))
    assert list(survey.attributes) == ["intensity"]
    assert survey.warnings == (
        "125 values of intensity are marked invalid: no value there.",
        "125 of 500 points have no colour, or one that is marked as invalid: they are grey.",
    )


@pytest.mark.parametrize(
    ("rotation", "says"),
    [((0.0, 0.0, 0.0, 0.0), "0 0 0 0, which is not a rotation"), (HALF_TURN * 2.0, "of length 2")],
)
def test_a_quaternion_that_is_no_unit(tmp_path, sample, rotation, says: str) -> None:
    local = sample.points - OFFSET
    move = np.array([100.0, 50.0, 5.0])
    is_turned = any(rotation)
    turned = np.stack([-local[:, 1], local[:, 0], local[:, 2]], axis=1) if is_turned else local
    scan = {"columns": columns(sample), "rotation": rotation, "translation": move}
    survey = read_in_order(write_e57(tmp_path / "a.e57", [scan]), turned + move)
    assert says in survey.warnings[0]


def test_a_pose_that_lacks_a_number_is_refused(tmp_path, sample) -> None:
    for pose in ({"translation": (1.0, 2.0)}, {"rotation": (1.0, 0.0, 0.0)}):
        path = write_e57(tmp_path / "a.e57", [{"columns": columns(sample), **pose}])
        with pytest.raises(ReadError, match="pose of scan 0"):
            read_survey(path)
        path.unlink()


def test_the_pose_turns_normals_too(tmp_path, sample) -> None:
    rng = np.random.default_rng(2)
    normals = rng.normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    local = sample.points - OFFSET
    extra = {f"nor:normal{axis}": normals[:, k] for k, axis in enumerate("XYZ")}
    scan = {
        "columns": columns(sample, **extra),
        "rotation": HALF_TURN,
        "translation": (7.0, 0.0, 0.0),
    }
    survey = read_in_order(
        write_e57(tmp_path / "a.e57", [scan]),
        np.stack([-local[:, 1] + 7.0, local[:, 0], local[:, 2]], axis=1),
    )
    got = np.stack([survey.attributes[f"nor:normal{axis}"] for axis in "XYZ"], axis=1)
    expected = np.stack([-normals[:, 1], normals[:, 0], normals[:, 2]], axis=1)
    np.testing.assert_allclose(got, expected, atol=1e-9)


def test_spherical_scans_have_marks_of_their_own(tmp_path, sample) -> None:
    local = sample.points - OFFSET + 5.0
    reach = np.linalg.norm(local, axis=1)
    bad = np.arange(500) % 10 == 0
    data = {
        "sphericalRange": reach,
        "sphericalAzimuth": np.arctan2(local[:, 1], local[:, 0]),
        "sphericalElevation": np.arcsin(local[:, 2] / reach),
        "sphericalInvalidState": bad.astype(np.uint8),
    }
    survey = read_in_order(write_e57(tmp_path / "a.e57", [{"columns": data}]), local[~bad])
    assert survey.warnings[0] == "50 points that the scanner marked invalid were left out."


def test_intensities_of_different_ranges_are_told(tmp_path, sample) -> None:
    def scan(rows, top: float):
        data = columns(sample, rows, intensity=sample.grade[rows] * top)
        return {
            "columns": data,
            "intensityLimits": {"intensityMinimum": 0.0, "intensityMaximum": top},
        }

    first, second = np.arange(250), np.arange(250, 500)
    path = write_e57(tmp_path / "a.e57", [scan(first, 1.0), scan(second, 2047.0)])
    assert "0 to 1 in scan 0 and 0 to 2047 in scan 1" in " ".join(read_survey(path).warnings)
    path = write_e57(tmp_path / "b.e57", [scan(first, 1.0), scan(second, 1.3)])
    assert read_survey(path).warnings == ()
