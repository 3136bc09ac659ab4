"""Heights that stand for "no data", in every format, and real ones that resemble them."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from pipeline.e57_files import write_e57

from terraport_pipeline.errors import ReadError
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages import read_streamed
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.survey.find_survey import find_survey

COUNT = 6000
RNG = np.random.default_rng(17)
GROUND = RNG.uniform(0, 60, (COUNT, 3))
GROUND[:, 2] = 300 + 5 * np.sin(GROUND[:, 0] / 9) + 0.1 * GROUND[:, 1]
GROUND = np.round(GROUND, 3)
SOME = RNG.random(COUNT) < 0.07


def with_heights(where: np.ndarray, *values: float, ground: np.ndarray = GROUND) -> np.ndarray:
    points = ground.copy()
    points[where, 2] = np.resize(values, int(where.sum()))
    return points


def raised(points: np.ndarray, by_m: float) -> np.ndarray:
    return np.column_stack([points[:, :2], points[:, 2] + by_m])


def write_ply(path: Path, points: np.ndarray) -> Path:
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    head += [f"property double {axis}" for axis in "xyz"]
    data = np.ascontiguousarray(points, "<f8").tobytes()
    path.write_bytes("\n".join([*head, "end_header\n"]).encode() + data)
    return path


def write_las(path: Path, points: np.ndarray) -> Path:
    las = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
    las.header.scales = np.full(3, 0.001)
    las.x, las.y, las.z = points.T
    las.write(path)
    return path


def write_csv(path: Path, points: np.ndarray) -> Path:
    np.savetxt(path, points, fmt="%.10g", delimiter=",", header="x,y,z", comments="")
    return path


def write_scan(path: Path, points: np.ndarray) -> Path:
    columns = {f"cartesian{axis}": points[:, k] for k, axis in enumerate("XYZ")}
    return write_e57(path, [{"columns": columns}])


def void_warnings(warnings) -> str:
    return "\n".join(text for text in warnings if "no data" in text)


@pytest.mark.parametrize(
    ("name", "write"),
    [("a.ply", write_ply), ("a.las", write_las), ("a.csv", write_csv), ("a.e57", write_scan)],
)
def test_heights_without_data_are_left_out_of_every_format(tmp_path, name, write) -> None:
    path = write(tmp_path / name, with_heights(SOME, -9999, 0))
    survey = read_survey(path)
    assert len(survey.points) == COUNT - SOME.sum()
    assert survey.points[:, 2].min() > 290
    half = int(SOME.sum()) // 2
    told = void_warnings(survey.warnings)
    assert f"{SOME.sum() - half:,} of {COUNT:,} points have the height -9,999" in told
    assert f"{half:,} of {COUNT:,} points have the height 0" in told
    assert told.count("left out") == 2


@pytest.mark.parametrize(
    "value", [-32768, -99999, -2147483.648, 99999, 1e6, -999, 1000, 3.4028234663852886e38, -1e30]
)
def test_other_values_without_data(tmp_path: Path, value: float) -> None:
    survey = read_survey(write_ply(tmp_path / "a.ply", with_heights(SOME, value)))
    np.testing.assert_array_equal(survey.points.max(axis=0), GROUND[~SOME].max(axis=0))
    np.testing.assert_array_equal(survey.points.min(axis=0), GROUND[~SOME].min(axis=0))
    assert f"{SOME.sum():,} of {COUNT:,} points have" in void_warnings(survey.warnings)


def test_a_third_in_mountains_and_a_frame_around_a_raster(tmp_path: Path) -> None:
    mountains = GROUND * np.array([20.0, 20.0, 1.0])
    mountains[:, 2] = 300 + mountains[:, 0] / 2
    third = RNG.random(COUNT) < 0.33
    for where, value in ((third, 0.0), (GROUND[:, 0] < 12, -9999.0)):
        path = write_ply(tmp_path / "a.ply", with_heights(where, value, ground=mountains))
        survey = read_survey(path)
        assert len(survey.points) == COUNT - where.sum()
        assert survey.points[:, 2].min() >= 300


def test_real_heights_that_are_shared_stay(tmp_path: Path) -> None:
    """Still water, at 0 or not, before a shore, a low plateau or a cliff; a datum of 0; a roof."""
    level = raised(GROUND, -300.0)
    lake = (level[:, 0] - 30) ** 2 + (level[:, 1] - 30) ** 2 < 200
    cases = {
        "about 0": level,
        "shore": with_heights(level[:, 2] < 0, 0.0, ground=level),
        "plateau": with_heights(lake, 0.0, ground=raised(level, 20.0)),
        "roof": with_heights(
            lake, 42.0, ground=np.column_stack([level[:, :2], np.rint(level[:, 2])])
        ),
        "canopy": with_heights(SOME, 0.0, ground=raised(level, 30.0)),
        "bathymetry": raised(level, -9500.0),
    }
    for name, points in cases.items():
        survey = read_survey(write_ply(tmp_path / "a.ply", points))
        assert len(survey.points) == COUNT, name
        assert "left out" not in void_warnings(survey.warnings), name
    # At the foot of a cliff it stays as well, and is told: it may be a block without data.
    points = with_heights(lake, 0.0, ground=raised(level, 90.0))
    points = points + np.array([5e5, 4e6, 0.0])
    points[::500] = 0.0  # strays, which must not make cells wide
    survey = read_survey(write_ply(tmp_path / "a.ply", points))
    assert len(survey.points) >= COUNT - COUNT // 500
    assert "they are kept" in void_warnings(survey.warnings)


def test_tiles_agree_on_what_is_no_height(tmp_path: Path) -> None:
    """The same points left out of one file and of its tiles, and the counts of each."""
    points = with_heights(SOME, -9999, 0)
    whole, tiles = tmp_path / "whole", tmp_path / "tiles"
    whole.mkdir(), tiles.mkdir()
    write_las(whole / "a.las", points)
    for number in range(3):
        inside = (points[:, 0] // 20).astype(int) == number
        write_las(tiles / f"{number}.las", points[inside])
    one, several = (read_survey(find_survey(folder)) for folder in (whole, tiles))
    np.testing.assert_array_equal(one.points, several.points)
    assert void_warnings(one.warnings) == void_warnings(several.warnings)
    folder = tmp_path / "columns"
    folder.mkdir()
    _, facts = read_streamed.run(find_survey(tiles), folder, Context(folder, NullProgress()))
    assert [file["outside"] for file in facts.notes["files"]] == [0, 0, 0]
    assert facts.counts["points"] == COUNT - SOME.sum()


def test_thinning_does_not_change_the_rule(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.las", with_heights(SOME, 0))
    survey = read_survey(path, max_points=500)
    assert len(survey.points) == 500
    assert survey.points[:, 2].min() > 290
    assert f"{SOME.sum():,} of {COUNT:,} points" in void_warnings(survey.warnings)


def test_nothing_but_points_without_height_is_no_survey(tmp_path: Path) -> None:
    points = with_heights(np.ones(COUNT, bool), -3.4028234663852886e38)
    with pytest.raises(ReadError, match="stands for no data; no other is left"):
        read_survey(write_ply(tmp_path / "a.ply", points))


def test_attributes_without_data_in_other_formats(tmp_path: Path) -> None:
    """Float extremes are no values; a usual code is told, as it may be one."""
    grade = np.where(SOME, np.float32(-3.4028235e38), np.float32(1.5))
    grade[::2] = 2.5
    code = np.where(SOME, -9999, 7)
    code[0] = 8
    path = tmp_path / "a.csv"
    table = np.column_stack([GROUND, grade, code])
    form = ["%.3f"] * 3 + ["%.8g", "%d"]
    np.savetxt(path, table, fmt=form, delimiter=",", header="x,y,z,grade,code", comments="")
    survey = read_survey(path)
    gone = SOME & (np.arange(COUNT) % 2 == 1)
    assert np.isnan(survey.attributes["grade"]).sum() == gone.sum()
    assert np.nanmin(survey.attributes["grade"]) == 1.5
    assert survey.attributes["code"].min() == -9999
    told = void_warnings(survey.warnings)
    assert f"Attribute 'code' is -9,999 in {(code == -9999).sum():,} points" in told
    assert f"Attribute 'grade' has {gone.sum():,} values beyond 1e30" in told
