from __future__ import annotations

from pathlib import Path

import numpy as np
import pye57
import pytest
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
    assert (survey.colours[300:] == 0).all()
    assert "Some scans have no colour; their points are black." in survey.warnings


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
