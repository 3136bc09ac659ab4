"""Which meaning of a file's coordinates is taken, and what is said when none fits."""

from __future__ import annotations

import numpy as np
import pytest
from pipeline.engines.camera_files.known_cameras import (
    BROWN,
    OFFSET,
    ORIGIN,
    UTM_15N,
    assert_same_pixels,
    flight,
    ground,
    write_agisoft,
    write_colmap_text,
    write_opensfm,
)
from pyproj import CRS

from terraport_pipeline.engines.camera_files import read_cameras
from terraport_pipeline.errors import PhotoError, ReadError
from terraport_pipeline.model import Crs


def test_the_user_has_the_last_word(tmp_path):
    cameras = flight(BROWN)
    write_colmap_text(tmp_path, cameras)
    (tmp_path / "OFFSET.txt").write_text("1 2 3\n")
    camera_set = read_cameras(tmp_path, origin=ORIGIN, crs=None, samples=ground(), offset=OFFSET)
    assert_same_pixels(camera_set.views, cameras)
    assert "--camera-offset" in camera_set.frame


def test_an_offset_already_applied_is_noticed(tmp_path):
    cameras = flight(BROWN)
    write_colmap_text(tmp_path, cameras, offset=(0.0, 0.0, 0.0))
    (tmp_path / "OFFSET.txt").write_text("{} {} {}\n".format(*OFFSET))
    camera_set = read_cameras(tmp_path, origin=ORIGIN, crs=None, samples=ground())
    assert_same_pixels(camera_set.views, cameras)
    assert "own coordinates" in camera_set.frame


def test_without_samples_the_file_is_believed(tmp_path):
    cameras = flight(BROWN)
    write_colmap_text(tmp_path, cameras)
    camera_set = read_cameras(tmp_path, origin=ORIGIN, crs=None)
    assert_same_pixels(camera_set.views, cameras)
    assert camera_set.seen is None


def test_an_offset_file_without_numbers_is_an_error(tmp_path):
    write_colmap_text(tmp_path, flight(BROWN))
    (tmp_path / "OFFSET.txt").write_text("ask EPSG:32615\n")
    with pytest.raises(ReadError, match=r"OFFSET.txt: no line has three numbers"):
        read_cameras(tmp_path, origin=ORIGIN, crs=None)


def test_cameras_elsewhere_are_refused_with_all_that_is_known(tmp_path):
    write_colmap_text(tmp_path, flight(BROWN))
    (tmp_path / "OFFSET.txt").write_text("400000 5188100 0\n")
    with pytest.raises(PhotoError) as caught:
        read_cameras(tmp_path, origin=ORIGIN, crs=None, samples=ground())
    message = str(caught.value)
    assert "6 photos do not look at the cloud" in message
    assert "400,000.000, 5,188,100.000, 0.000 m (OFFSET.txt): around E 400,1" in message
    assert "0.0% seen" in message
    assert "the cloud lies around E 576,7" in message
    assert "--camera-offset E,N,H" in message


def test_a_camera_in_space_sees_no_cloud(tmp_path):
    write_colmap_text(tmp_path, flight(BROWN))
    with pytest.raises(PhotoError, match="do not look at the cloud"):
        read_cameras(
            tmp_path, origin=ORIGIN, crs=None, samples=ground(), offset=(*OFFSET[:2], 300_000.0)
        )


def test_a_cloud_mostly_beyond_the_photos_is_told(tmp_path):
    write_colmap_text(tmp_path, flight(BROWN))
    wide = ground() * (5.0, 1.0, 5.0)
    camera_set = read_cameras(tmp_path, origin=ORIGIN, crs=None, samples=wide)
    assert 0.01 < camera_set.seen < 0.5
    assert "of the cloud lies in any photo" in camera_set.warnings[0]


def test_earth_centred_cameras_need_a_survey_with_a_crs(tmp_path):
    path = tmp_path / "cameras.xml"
    write_agisoft(path, flight(BROWN), "EPSG:4326")
    with pytest.raises(PhotoError, match="the survey states no coordinate reference system"):
        read_cameras(path, origin=ORIGIN, crs=None, samples=ground())
    with pytest.raises(PhotoError, match="Tried: as Earth-centred"):
        read_cameras(path, origin=ORIGIN, crs=UTM_15N, samples=ground())


def test_heights_above_a_geoid_are_warned_of(tmp_path):
    path = tmp_path / "reconstruction.json"
    reference = {"latitude": 46.84, "longitude": -91.99, "altitude": 160.0}
    cameras = flight(BROWN)
    write_opensfm(path, cameras, offset=ORIGIN, reference=reference)
    compound = Crs(
        "UTM 15N + EGM96",
        CRS.from_user_input("EPSG:32615+5773").to_wkt(),
    )
    camera_set = read_cameras(path, origin=ORIGIN, crs=compound)
    assert "above a geoid" in camera_set.warnings[0]


def test_utm_turns_north_and_shrinks_the_ground(tmp_path):
    """At the edge of its zone, grid north is 2 degrees off: the poses must turn with it."""
    path = tmp_path / "reconstruction.json"
    names, turns, centres, lens = flight(BROWN)
    local = names, turns, centres - ORIGIN, lens
    reference = {"latitude": 46.8, "longitude": -90.1, "altitude": 0.0}
    write_opensfm(path, local, offset=(0, 0, 0), reference=reference)
    camera_set = read_cameras(path, origin=ORIGIN, crs=UTM_15N)
    forward = np.array([view.rotation[2] for view in camera_set.views])
    right = np.array([view.rotation[0] for view in camera_set.views])
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    expected = turns[:, 0] @ axes.T
    turned_deg = np.degrees(
        np.arctan2(
            right[:, 0] * expected[:, 2] - right[:, 2] * expected[:, 0],
            right[:, 0] * expected[:, 0] + right[:, 2] * expected[:, 2],
        )
    )
    convergence_deg = np.degrees(np.arctan(np.tan(np.radians(2.9)) * np.sin(np.radians(46.8))))
    assert np.abs(np.abs(turned_deg) - convergence_deg).max() < 0.2
    assert np.abs(forward - turns[:, 2] @ axes.T).max() < 0.05
