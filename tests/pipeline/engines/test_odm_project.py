"""A project of OpenDroneMap is one survey: its georeferenced cloud, its photos, its cameras."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from pipeline.engines.camera_files.known_cameras import (
    BROWN,
    HEIGHT,
    WIDTH,
    flight,
    write_opensfm,
    write_shots_geojson,
)

from terraport_pipeline.engines.odm_project import find_odm_project
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.workflow.photo_input import locate_photos, photo_folder, project_texturing


def picture(path, size=(WIDTH // 10, HEIGHT // 10)):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.zeros((size[1], size[0], 3), np.uint8)).save(path)


@pytest.fixture
def project(tmp_path):
    """As it lies on disk: the cloud three times over, the photos twice."""
    folder = tmp_path / "quarry"
    for name in (
        "odm_georeferencing/odm_georeferenced_model.laz",
        "entwine_pointcloud/ept-data/0-0-0-0.laz",
        "odm_filterpoints/point_cloud.laz",
    ):
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_bytes(b"LASF" + bytes(400))
    (folder / "odm_georeferencing" / "coords.txt").write_text("WGS84 UTM 15N\n576600 5188100\n")
    cameras = flight(BROWN)
    write_opensfm(folder / "opensfm" / "reconstruction.json", cameras)
    for name in cameras[0]:
        picture(folder / "images" / name)
        picture(folder / "images_resize" / name)
        picture(folder / "opensfm" / "undistorted" / "images" / f"{name}.tif")
    return folder


def test_the_cloud_is_the_georeferenced_one_alone(project):
    survey = find_survey(project)
    assert [file.name for file in survey.files] == ["odm_georeferenced_model.laz"]
    assert survey.ignored == (
        ("other files", "an OpenDroneMap project is its odm_georeferenced_model.laz"),
    )


def test_photos_are_the_originals(project):
    found = find_odm_project(project)
    assert found is not None
    assert found.photos == project / "images"
    located = locate_photos(Texturing(photos=project), NullProgress())
    assert located is not None
    assert located.count == 6
    assert located.format == "OpenSfM"
    beside = locate_photos(Texturing(photos=project / "images"), NullProgress())
    assert beside is not None
    assert beside.photos_xxh3 == located.photos_xxh3


def test_the_project_given_as_the_survey_brings_its_photos(project):
    texturing = project_texturing([project])
    assert texturing is not None
    assert photo_folder(texturing) == project / "images"
    assert project_texturing([project / "images"]) is None
    assert project_texturing([project, project]) is None


def test_all_assets_without_photos_are_a_cloud(project):
    for path in sorted((project / "images").iterdir()):
        path.unlink()
    (project / "images").rmdir()
    assert project_texturing([project]) is None


def test_shots_of_all_assets(tmp_path):
    cameras = flight(BROWN)
    write_shots_geojson(tmp_path, cameras)
    for name in cameras[0]:
        picture(tmp_path / "images" / name)
    located = locate_photos(Texturing(photos=tmp_path), NullProgress())
    assert located is not None
    assert located.format == "OpenDroneMap shots"


def test_any_other_folder_is_no_project(tmp_path):
    (tmp_path / "images").mkdir()
    assert find_odm_project(tmp_path) is None
    assert find_odm_project(tmp_path / "nowhere") is None
