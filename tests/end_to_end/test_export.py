"""A survey, its scene, and what is handed on: opened by other readers, they are in one place."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
import trimesh
from command_line import Built, run_terraport
from scipy.spatial import cKDTree

STEP_M = 1.0


@pytest.fixture(scope="module")
def survey(built: Built) -> np.ndarray:
    """Points of the survey (N, 3), by another reader than terraport's own."""
    return np.asarray(laspy.read(built.survey).xyz)


@pytest.fixture(scope="module")
def exports(built: Built, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a height model, an orthophoto, points and a mesh of the quarry."""
    folder = tmp_path_factory.mktemp("exports")
    for name, *options in (
        ("h.tif", "--as", "heights", "--step-m", str(STEP_M)),
        ("o.tif", "--as", "orthophoto", "--step-m", str(STEP_M)),
        ("p.laz",),
        ("m.ply",),
    ):
        done = run_terraport("export", built.scene, "-o", folder / name, *options)
        assert done.returncode == 0, done.stderr
        assert "coordinates: WGS 84 / UTM zone 35S, unit m" in done.stdout
    return folder


def differences(
    picture: rasterio.DatasetReader, values: np.ndarray, survey: np.ndarray, moved: tuple[int, int]
) -> np.ndarray:
    """Values of the pixels that survey points lie in, as if the picture were moved by pixels."""
    rows, columns = rasterio.transform.rowcol(picture.transform, survey[:, 0], survey[:, 1])
    rows, columns = np.asarray(rows) + moved[0], np.asarray(columns) + moved[1]
    rows = rows.astype(int).clip(0, picture.height - 1)
    columns = columns.astype(int).clip(0, picture.width - 1)
    return values[rows, columns]


MOVES = ((2, 0), (-2, 0), (0, 2), (0, -2))
"""Two pixels either way: a picture that is off by one is nearer on one side."""


def test_the_height_model_is_the_survey_and_not_beside_it(survey, exports) -> None:
    with rasterio.open(exports / "h.tif") as picture:
        assert picture.crs.to_epsg() == 32735
        heights = picture.read(1, masked=True).filled(np.nan)

        def off(moved: tuple[int, int]) -> np.ndarray:
            found = np.abs(differences(picture, heights, survey, moved) - survey[:, 2])
            return found[np.isfinite(found)]

        here = off((0, 0))
        around = [off(moved).mean() for moved in MOVES]
    # The survey's points are 2.4 m apart; most lie on level ground, some on walls.
    assert len(here) > 0.99 * len(survey)
    assert np.median(here) < 0.25 * STEP_M
    assert np.percentile(here, 75) < STEP_M
    assert here.mean() < 0.8 * min(around)
    # Moved to either side it is about equally wrong: it lies in the middle, within half a step.
    assert max(around) < 1.35 * min(around)


def test_the_orthophoto_shows_the_survey_and_not_what_is_beside_it(built, survey, exports) -> None:
    las = laspy.read(built.survey)
    colours = np.stack([las.red, las.green, las.blue], axis=1) >> 8
    with rasterio.open(exports / "o.tif") as picture:
        assert picture.crs.to_epsg() == 32735
        levels = picture.read()[:3].transpose(1, 2, 0).astype(float)

        def off(moved: tuple[int, int]) -> float:
            found = differences(picture, levels, survey, moved)
            return float(np.abs(found - colours).mean())

        assert off((0, 0)) < 12
        assert off((0, 0)) < min(off(moved) for moved in MOVES)


def test_points_and_mesh_lie_on_the_survey(survey, exports) -> None:
    tree = cKDTree(survey)
    las = laspy.read(exports / "p.laz")
    assert las.header.parse_crs().to_epsg() == 32735
    points = np.asarray(las.xyz)
    mesh = trimesh.load(exports / "m.ply", process=False)
    vertices = mesh.vertices + np.loadtxt(exports / "m.ply.offset.xyz")
    for some in (points, vertices):
        # To the nearest point of the survey: less than its points are apart.
        assert np.median(tree.query(some)[0]) < 1.6
        assert np.abs(np.median(some - survey[tree.query(some)[1]], axis=0)).max() < 0.15
    assert np.median(cKDTree(points).query(survey)[0]) < 1.2
    assert "grade" in las.point_format.extra_dimension_names
