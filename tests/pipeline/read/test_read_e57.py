from __future__ import annotations

from pathlib import Path

import numpy as np
import pye57
import pytest

from terraport_pipeline.engines.readers.read_e57 import read_e57
from terraport_pipeline.errors import ReadError

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


def test_all_scans_with_their_poses(tmp_path, sample, advance) -> None:
    raw = read_e57(write(tmp_path / "a.e57", sample), advance=advance)
    local = (sample.points - OFFSET).astype(np.float32).astype(np.float64)
    np.testing.assert_allclose(raw.points[:300], local[:300] + OFFSET, rtol=0, atol=1e-6)
    turned = np.stack([-local[300:, 1], local[300:, 0], local[300:, 2]], axis=1)
    np.testing.assert_allclose(raw.points[300:], turned + OFFSET, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(raw.colours, sample.colours)
    np.testing.assert_allclose(raw.attributes["intensity"], sample.grade, rtol=1e-6)
    assert np.bincount(raw.attributes["scan"]).tolist() == [300, 200]


def test_points_marked_invalid_are_left_out_and_counted(tmp_path, sample, advance) -> None:
    data = fields(sample, slice(0, 500))
    data["cartesianInvalidState"] = (np.arange(500) % 5 == 0).astype(np.int8)
    path = tmp_path / "a.e57"
    with pye57.E57(str(path), mode="w") as file:
        file.write_scan_raw(data)
    raw = read_e57(path, advance=advance)
    assert len(raw.points) == 400
    np.testing.assert_array_equal(raw.colours, sample.colours[np.arange(500) % 5 != 0])
    assert raw.warnings == ("100 points that the scanner marked invalid were left out.",)


def test_a_scan_without_colour_beside_one_with(tmp_path, sample, advance) -> None:
    path = tmp_path / "a.e57"
    with pye57.E57(str(path), mode="w") as file:
        file.write_scan_raw(fields(sample, slice(0, 300)))
        file.write_scan_raw(fields(sample, slice(300, 500), colours=False))
    raw = read_e57(path, advance=advance)
    np.testing.assert_array_equal(raw.colours[:300], sample.colours[:300])
    assert (raw.colours[300:] == 0).all()
    assert "Some scans have no colour; their points are black." in raw.warnings


def test_thinning_over_scans(tmp_path, sample, advance) -> None:
    raw = read_e57(write(tmp_path / "a.e57", sample), advance=advance, max_points=50)
    assert len(raw.points) == 50
    assert np.bincount(raw.attributes["scan"]).tolist() == [30, 20]


def test_coordinates_too_large_for_32_bits_are_named(tmp_path, sample, advance) -> None:
    data = fields(sample, slice(0, 500))
    data["cartesianY"] = data["cartesianY"] + OFFSET[1]  # pye57 writes 32-bit floats
    path = tmp_path / "a.e57"
    with pye57.E57(str(path), mode="w") as file:
        file.write_scan_raw(data)
    (warning,) = read_e57(path, advance=advance).warnings
    assert "steps of 1 m" in warning


def test_no_scan_is_an_error(tmp_path, advance) -> None:
    path = tmp_path / "a.e57"
    with pye57.E57(str(path), mode="w"):
        pass
    with pytest.raises(ReadError, match="0 scans with 0 points"):
        read_e57(path, advance=advance)


def test_damage_is_a_read_error_and_the_file_stays(tmp_path, sample) -> None:
    path = write(tmp_path / "a.e57", sample)
    data = path.read_bytes()
    for length in range(8, len(data) - 1, 2003):
        path.write_bytes(data[:length])
        with pytest.raises(ReadError):
            read_e57(path, advance=lambda count, total: None)
        assert path.exists()
    spoilt = bytearray(data)
    spoilt[1500] ^= 0xFF  # within the second page: its checksum no longer fits
    path.write_bytes(spoilt)
    with pytest.raises(ReadError):
        read_e57(path, advance=lambda count, total: None)
