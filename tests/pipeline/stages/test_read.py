from __future__ import annotations

import shutil
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

from terraport_pipeline.engines.readers.survey_format import find_format
from terraport_pipeline.errors import OptionError, ReadError, SurveyError
from terraport_pipeline.stages.read import read_survey

PLY = "ply\nformat ascii 1.0\nelement vertex {n}\n{p}end_header\n{rows}"
XYZ = "property {t} x\nproperty {t} y\nproperty {t} z\n"


class Recorder:
    """A Progress that keeps what it is told."""

    def __init__(self) -> None:
        self.steps: list[tuple[str, float | None, str]] = []
        self.amount = 0.0
        self.facts: dict[str, object] = {}

    def start(self, stage: str, total: float | None, unit: str) -> None:
        self.steps.append((stage, total, unit))

    def advance(self, n: float) -> None:
        self.amount += n

    def done(self, facts) -> None:
        self.facts.update(facts)


def ply(path: Path, rows: list[str], kind: str = "double") -> Path:
    body = "".join(row + "\n" for row in rows)
    path.write_text(PLY.format(n=len(rows), p=XYZ.format(t=kind), rows=body))
    return path


def test_content_decides_not_the_name(tmp_path: Path) -> None:
    path = ply(tmp_path / "survey.laz", ["1 2 3", "4 5 6"])
    assert find_format(path) == "ply"
    survey = read_survey(path)
    assert survey.format == "ply"
    assert survey.points.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


def test_points_without_finite_coordinates_are_dropped_with_their_values(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x,y,z,r,g,b,grade\n1,2,nan,9,9,9,0.5\n4,5,6,10,20,30,1.5\n7,,9,8,8,8,2.5\n")
    survey = read_survey(path)
    assert survey.points.tolist() == [[4.0, 5.0, 6.0]]
    assert survey.colours is not None
    assert survey.colours.tolist() == [[10, 20, 30]]
    assert survey.attributes["grade"].tolist() == [1.5]
    assert survey.warnings == ("2 of 3 points have no finite coordinates: dropped.",)


def test_a_colour_that_is_nan_turns_grey_and_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x,y,z,r,g,b\n1,2,3,nan,1,2\n4,5,6,10,20,30\n")
    survey = read_survey(path)
    assert survey.colours is not None
    assert survey.colours.tolist() == [[160, 160, 160], [10, 20, 30]]
    assert any("1 of 2 points have no colour" in text for text in survey.warnings)


def test_no_finite_point_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match="not one of 2 points has finite coordinates"):
        read_survey(ply(tmp_path / "a.ply", ["nan 1 2", "1 inf 2"]))


def test_no_colour_is_said(tmp_path: Path) -> None:
    survey = read_survey(ply(tmp_path / "a.ply", ["1 2 3", "4 5 6.5"]))
    assert survey.colours is None
    assert survey.warnings == ("The survey has no colour (RGB): what no photo shows will be grey.",)


def test_utm_in_32_bit_floats_is_named_with_its_step(tmp_path: Path) -> None:
    rows = ["641200.0 8594700.0 1287.25", "641201.5 8594703.0 1288.5"]
    survey = read_survey(ply(tmp_path / "a.ply", rows, "float"))
    assert "near 8,594,703 m" in survey.warnings[0]
    assert "steps of 1 m" in survey.warnings[0]
    local = read_survey(ply(tmp_path / "b.ply", ["1.5 2.5 3.5", "4 5 6"], "float"))
    assert len(local.warnings) == 1  # only that there is no colour


def test_feet_are_converted(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = np.full(3, 0.01), np.array([6.5e6, 1.9e6, 0.0])
    header.add_crs(CRS.from_epsg(2229))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.array([[6.5e6, 6.5e6 + 100], [1.9e6, 1.9e6 + 50], [500.0, 510.0]])
    las.write(tmp_path / "a.las")
    survey = read_survey(tmp_path / "a.las")
    np.testing.assert_allclose(np.ptp(survey.points, axis=0), np.array([100, 50, 10]) * 0.3048006)
    assert survey.crs is not None
    assert survey.crs.name.endswith("(in metres)")


def test_progress_counts_every_point(tmp_path: Path) -> None:
    progress = Recorder()
    read_survey(ply(tmp_path / "a.ply", ["1 2 3"] * 9), progress=progress)
    assert progress.steps == [("read a.ply", 9, "points"), ("read: order", 18, "points")]
    assert progress.amount == 27
    assert progress.facts == {"points": 1}  # eight repeat the first


def test_max_points(tmp_path: Path) -> None:
    path = ply(tmp_path / "a.ply", [f"{n} 0 0" for n in range(100)])
    thin = read_survey(path, max_points=10)
    assert len(thin.points) == 10
    np.testing.assert_array_equal(thin.points, read_survey(path, max_points=10).points)
    with pytest.raises(OptionError, match="max_points is 0"):
        read_survey(path, max_points=0)


def test_damaged_coordinates_far_away_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match="the coordinates span 1e\\+30"):
        read_survey(ply(tmp_path / "a.ply", ["1 2 3", "1e30 2 3"]))


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.laz", b"", "the file is empty"),
        ("a.laz", b"GARBAGE and more", "starts with b'GARBAGE ', expected b'LASF'"),
        ("a.e57", b"GARBAGE and more", "expected b'ASTM-E57'"),
        ("a.las", b"version https://git-lfs.github.com/spec/v1\n", "a Git LFS pointer"),
        ("a.laz", b"PK\x03\x04....", "a ZIP archive"),
        ("a.laz", b"<!DOCTYPE html>", "a web page"),
        (
            "dem.tif",
            b"II*\x00\x08\x00\x00\x00",
            "a TIFF picture, no survey; terraport wants the points",
        ),
        ("a.obj", b"v 1 2 3\n", ".obj is no known kind of survey"),
        ("survey", b"v 1 2 3\n", "a name without ending is no known kind"),
    ],
)
def test_wrong_files_are_named(tmp_path: Path, name: str, data: bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(ReadError) as caught:
        read_survey(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert isinstance(caught.value, SurveyError)


def test_missing_files_and_folders(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match="there is no such file"):
        read_survey(tmp_path / "none.laz")
    with pytest.raises(ReadError, match="this is a folder"):
        read_survey(tmp_path)


# Real surveys


def test_stray_points_far_from_all_others_are_dropped(tmp_path: Path) -> None:
    ground = [f"{480_000 + n % 20} {2_210_000 + n // 20} {1_200 + n % 7}" for n in range(400)]
    survey = read_survey(ply(tmp_path / "a.ply", ["0 0 0", *ground, "4e30 1 1"]))
    assert len(survey.points) == 400
    assert survey.points.min(axis=0).tolist() == [480_000, 2_210_000, 1_200]
    assert any("2 of 402 points lie more than 100 km" in text for text in survey.warnings)
    with pytest.raises(SurveyError, match="expected one site"):
        read_survey(ply(tmp_path / "b.ply", [*["0 0 0"] * 10, *ground]))


def test_a_grid_of_half_metres_is_told(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [0.5, 0.5, 0.5]
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.arange(30).reshape(3, 10) * 0.5
    las.write(tmp_path / "a.las")
    assert any("in steps of 0.5" in text for text in read_survey(tmp_path / "a.las").warnings)


@pytest.mark.shared_data
@pytest.mark.parametrize(
    ("name", "points", "grey", "epsg"),
    [
        ("small_las/1.2-with-color.las", 1_065, False, None),
        ("lone_star_geyser/lone-star.copc.laz", 518_862, True, None),
        ("pcd/samp53-utm.pcd", 34_378, True, None),
        ("brighton_beach/model.laz", 940_393, False, 32615),
        ("apaxco_quarry/apaxco_quarry_500k.laz", 500_000, False, None),
    ],
)
def test_real_surveys(shared_data: Path, name: str, points: int, grey: bool, epsg) -> None:
    path = shared_data / name
    if not path.exists():
        pytest.skip(f"no {path}")
    survey = read_survey(path)
    assert survey.points.shape == (points, 3)
    assert (survey.colours is None) == grey
    assert grey == any("will be grey" in warning for warning in survey.warnings)
    assert (survey.crs.epsg if survey.crs else None) == epsg
    assert all(len(values) == points for values in survey.attributes.values())
    if survey.format == "las":
        with laspy.open(path) as reader:
            low, high = reader.header.mins, reader.header.maxs
        np.testing.assert_allclose(survey.points.min(axis=0), low, rtol=0, atol=0.011)
        np.testing.assert_allclose(survey.points.max(axis=0), high, rtol=0, atol=0.011)


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["churo_andes/churo_andes.laz", "red_rocks/red_rocks.laz"])
def test_large_real_surveys_thinned(shared_data: Path, name: str) -> None:
    path = shared_data / name
    if not path.exists():
        pytest.skip(f"no {path}")
    survey = read_survey(path, max_points=100_000)
    assert survey.points.shape == (100_000, 3)
    assert survey.colours is not None
    assert survey.colours.max(axis=0).min() > 200  # 16-bit colours came down to 8 bits


@pytest.mark.shared_data
def test_traps_in_real_surveys_are_named(shared_data: Path) -> None:
    geyser = shared_data / "lone_star_geyser/lone-star.copc.laz"
    pcd = shared_data / "pcd/samp53-utm.pcd"
    if not geyser.exists() or not pcd.exists():
        pytest.skip(f"no {geyser} or {pcd}")
    assert "Earth-centred" in read_survey(geyser, max_points=1000).warnings[0]
    assert "steps of 0.5 m" in read_survey(pcd).warnings[0]


@pytest.mark.shared_data
def test_a_real_survey_cut_off(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "apaxco_quarry/apaxco_quarry_500k.laz"
    if not source.exists():
        pytest.skip(f"no {source}")
    path = tmp_path / "cut.laz"
    shutil.copyfile(source, path)
    path.chmod(0o600)
    with path.open("r+b") as file:
        file.truncate(2_000_000)
    with pytest.raises(ReadError, match="about 37% of 500,000 points are there"):
        read_survey(path)
