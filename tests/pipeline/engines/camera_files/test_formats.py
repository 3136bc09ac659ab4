"""The same known cameras, written in every format, fall where the truth says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pycolmap
import pytest
from pipeline.engines.camera_files.known_cameras import (
    AXES,
    BROWN,
    FISHEYE,
    HEIGHT,
    OFFSET,
    ORIGIN,
    SQUARE,
    UTM_15N,
    WIDTH,
    assert_same_pixels,
    flight,
    ground,
    rotation_about,
    truth,
    write_agisoft,
    write_bundler,
    write_colmap_binary,
    write_colmap_text,
    write_opensfm,
    write_pix4d,
    write_pix4d_external,
    write_shots_geojson,
)
from pyproj import CRS, Transformer

from terraport_pipeline.engines.camera_files import read_cameras
from terraport_pipeline.engines.camera_files import write_colmap as our_colmap
from terraport_pipeline.engines.camera_files import write_opensfm as our_opensfm
from terraport_pipeline.errors import PhotoError
from terraport_pipeline.model import Crs

LENSES = pytest.mark.parametrize("lens", [BROWN, FISHEYE], ids=["brown", "fisheye"])


def read(path, **options):
    options = {"origin": ORIGIN, "crs": UTM_15N, "samples": ground(), **options}
    return read_cameras(path, **options)


@LENSES
@pytest.mark.parametrize("write", [write_colmap_text, write_colmap_binary])
def test_colmap(tmp_path, lens, write):
    cameras = flight(lens)
    write(tmp_path / "sparse" / "0", cameras)
    if write is write_colmap_binary:
        (tmp_path / "sparse" / "OFFSET.txt").write_text("576600 5188100 0\n")
    camera_set = read(tmp_path)
    assert_same_pixels(camera_set.views, cameras)
    assert camera_set.format == f"COLMAP ({'text' if write is write_colmap_text else 'binary'})"
    assert "576,600.000, 5,188,100.000, 0.000" in camera_set.frame
    assert camera_set.seen > 0.8
    assert camera_set.warnings == ()


def test_colmap_reads_what_colmap_itself_writes(tmp_path):
    cameras = flight(BROWN)
    write_colmap_text(tmp_path / "text", cameras)
    (tmp_path / "text" / "images.txt").write_text(
        # points that pycolmap would look for
        "\n".join(
            "" if line.startswith("10.5") else line
            for line in (tmp_path / "text" / "images.txt").read_text().splitlines()
        )
        + "\n"
    )
    (tmp_path / "text" / "points3D.txt").write_text("")
    model = pycolmap.Reconstruction(str(tmp_path / "text"))
    for folder, write in (("a", model.write_text), ("b", model.write_binary)):
        (tmp_path / folder).mkdir()
        write(str(tmp_path / folder))
        camera_set = read(tmp_path / folder, offset=OFFSET)
        assert_same_pixels(camera_set.views, cameras)


@LENSES
def test_opensfm_as_opendronemap_leaves_it(tmp_path, lens):
    cameras = flight(lens)
    write_opensfm(
        tmp_path / "opensfm" / "reconstruction.json",
        cameras,
        reference={"latitude": 46.8, "longitude": -92.0, "altitude": 0.0},
    )
    (tmp_path / "odm_georeferencing").mkdir()
    coords = tmp_path / "odm_georeferencing" / "coords.txt"
    coords.write_text("WGS84 UTM 15N\n576600 5188100\n1 2 3\n")
    camera_set = read(tmp_path)
    assert_same_pixels(camera_set.views, cameras)
    assert "coords.txt" in camera_set.frame


@pytest.mark.parametrize(
    ("kind", "lens"),
    [
        ("perspective", SQUARE),
        ("radial", SQUARE),
        ("simple_radial", replace(SQUARE, radial=(0.02,))),
        ("fisheye", replace(SQUARE, model="fisheye")),
    ],
)
def test_opensfm_models_with_one_focal_length(tmp_path, kind, lens):
    cameras = flight(lens)
    path = tmp_path / "reconstruction.json"
    write_opensfm(path, cameras, offset=(0, 0, 0))
    text = path.read_text().replace('"fisheye_opencv"', '"brown"')
    path.write_text(
        text.replace('"projection_type": "brown"', f'"projection_type": "{kind}"').replace(
            '"focal_x"', '"focal"'
        )
    )
    assert_same_pixels(read(path).views, cameras)


def a_place():
    """A projection true to scale where the survey lies, and its Earth-centred twin."""
    crs = CRS.from_proj4("+proj=tmerc +lat_0=46.8 +lon_0=-92 +k=1 +datum=WGS84 +units=m")
    return Crs(crs.name, crs.to_wkt(), None), np.array([20.0, 10.0, 0.0])


def enu_to_ecef(latitude, longitude, height):
    to_ecef = Transformer.from_crs(4979, 4978, always_xy=True)
    centre = np.array(to_ecef.transform(longitude, latitude, height))
    turn = rotation_about(2, longitude + 90) @ rotation_about(0, 90 - latitude)
    return turn, centre


def moved_flight(lens):
    """The flight over the point of reference, metres east, north, up of it."""
    names, turns, centres, lens = flight(lens)
    return names, turns, centres - ORIGIN, lens


def scene_truth(local):
    """Pixels by the local cameras, and the same points in the survey's scene."""
    names, turns, centres, lens = local
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-20, 60, (800, 2)), rng.uniform(-1, 1, 800)])
    turn, centre = enu_to_ecef(46.8, -92.0, 0.0)
    crs, origin = a_place()
    to_crs = Transformer.from_crs(4978, CRS.from_wkt(crs.wkt), always_xy=True)
    east, north, _ = to_crs.transform(*(points @ turn.T + centre).T)
    # a transverse Mercator has no height: it stays the one above the ellipsoid
    to_degrees = Transformer.from_crs(4978, 4979, always_xy=True)
    up = to_degrees.transform(*(points @ turn.T + centre).T)[2]
    scene = (np.column_stack([east, north, up]) - origin) @ AXES.T
    pixels = {
        name: lens.project((points - centre) @ turn.T)
        for name, turn, centre in zip(names, turns, centres, strict=True)
    }
    return crs, origin, scene, pixels


def assert_pixels(views, scene, pixels):
    for view in views:
        projected, _ = view.project(scene)
        expected = pixels[view.name if view.name in pixels else f"{view.name}.JPG"]
        inside = (np.abs(expected - (1000, 562)) < (1000, 562)).all(axis=1)
        assert inside.sum() > 50
        assert np.abs(projected - expected)[inside].max() < 0.01


def test_opensfm_about_its_reference(tmp_path):
    local = moved_flight(BROWN)
    crs, origin, scene, pixels = scene_truth(local)
    path = tmp_path / "reconstruction.json"
    reference = {"latitude": 46.8, "longitude": -92.0, "altitude": 0.0}
    write_opensfm(path, local, offset=(0, 0, 0), reference=reference)
    camera_set = read(path, origin=origin, crs=crs, samples=scene)
    assert "reference_lla" in camera_set.frame
    assert_pixels(camera_set.views, scene, pixels)


def test_agisoft_earth_centred(tmp_path):
    local = moved_flight(BROWN)
    crs, origin, scene, pixels = scene_truth(local)
    turn, centre = enu_to_ecef(46.8, -92.0, 0.0)
    names, turns, centres, lens = local
    earth_centred = names, turns @ turn.T, centres @ turn.T + centre, lens
    path = tmp_path / "cameras.xml"
    chunk = (
        9.13,
        rotation_about(0, 20) @ rotation_about(2, 70),
        centre + np.array([5.0, 6.0, 7.0]),
    )
    write_agisoft(path, earth_centred, CRS.from_epsg(4326).to_wkt("WKT1_GDAL"), (0, 0, 0), chunk)
    camera_set = read(path, origin=origin, crs=crs, samples=scene)
    assert "Earth-centred" in camera_set.frame
    assert camera_set.warnings == ("1 photos have no pose in cameras.xml; they are left out.",)
    assert_pixels(camera_set.views, scene, pixels)


@LENSES
def test_agisoft_in_local_coordinates(tmp_path, lens):
    cameras = flight(replace(lens, skew=0.3))
    path = tmp_path / "cameras.xml"
    write_agisoft(path, cameras, "LOCAL_CS[&quot;Local Coordinates (m)&quot;]")
    camera_set = read(tmp_path, offset=OFFSET)
    cameras[0][:] = [name.removesuffix(".JPG") for name in cameras[0]]
    assert_same_pixels(camera_set.views, cameras)


def test_agisoft_components_carry_their_own_transform(tmp_path):
    cameras = flight(BROWN)
    path = tmp_path / "cameras.xml"
    chunk = (2.0, rotation_about(2, 33), np.array([1.0, 2.0, 3.0]))
    write_agisoft(path, cameras, chunk=chunk)
    text = path.read_text()
    move = text[text.index("<transform><rotation>") : text.index("<reference>")]
    text = text.replace(move, "").replace(
        'sensor_id="0" label', 'sensor_id="0" component_id="3" label'
    )
    text = text.replace(
        "<cameras", f'<components><component id="3">{move}</component></components><cameras'
    )
    path.write_text(text)
    cameras[0][:] = [name.removesuffix(".JPG") for name in cameras[0]]
    assert_same_pixels(read(path, offset=OFFSET).views, cameras)


def test_photoscan_before_1_2(tmp_path):
    cameras = flight(BROWN)
    path = tmp_path / "cameras.xml"
    write_agisoft(path, cameras)
    text = path.read_text()
    start, end = text.index("<f>"), text.index("<k1>")
    p_start, p_end = text.index("<p1>"), text.index("</calibration>")
    p1, p2 = BROWN.tangential
    path.write_text(
        text[:start]
        + f"<fx>{BROWN.fx}</fx><fy>{BROWN.fy}</fy><cx>{BROWN.cx}</cx><cy>{BROWN.cy}</cy>"
        + text[end:p_start]
        + f"<p1>{p1}</p1><p2>{p2}</p2>"
        + text[p_end:]
    )
    cameras[0][:] = [name.removesuffix(".JPG") for name in cameras[0]]
    assert_same_pixels(read(path, offset=OFFSET).views, cameras)


def test_opendronemap_shots(tmp_path):
    cameras = flight(BROWN)
    write_shots_geojson(tmp_path, cameras)
    camera_set = read(tmp_path)
    assert_same_pixels(camera_set.views, cameras)
    assert camera_set.format == "OpenDroneMap shots"


def test_pix4d(tmp_path):
    cameras = flight(BROWN)
    write_pix4d(tmp_path / "1_initial" / "params", cameras)
    camera_set = read(tmp_path)
    assert_same_pixels(camera_set.views, cameras)
    assert "beach_offset.xyz" in camera_set.frame


def test_pix4d_external_with_internal_lens(tmp_path):
    cameras = flight(replace(BROWN, fy=BROWN.fx))
    path = write_pix4d_external(tmp_path, cameras)
    camera_set = read(path)
    scaled = [replace(view, lens=view.lens.scaled(WIDTH, HEIGHT)) for view in camera_set.views]
    assert_same_pixels(scaled, cameras)


def test_bundler(tmp_path):
    cameras = flight(SQUARE)
    write_bundler(tmp_path, cameras)
    asked_names = []
    camera_set = read(tmp_path, photo_size=lambda name: asked_names.append(name) or (WIDTH, HEIGHT))
    assert asked_names == cameras[0]
    assert_same_pixels(camera_set.views, cameras)
    assert camera_set.warnings == ("1 of 7 photos were not aligned by Bundler.",)


def test_bundler_leaves_out_cameras_whose_photo_is_gone(tmp_path):
    cameras = flight(SQUARE)
    write_bundler(tmp_path, cameras)
    gone = cameras[0][1]

    def size(name):
        if name == gone:
            raise PhotoError(f"photo {name} is not below photos, and its size is needed")
        return WIDTH, HEIGHT

    camera_set = read(tmp_path, photo_size=size)
    assert [view.name for view in camera_set.views] == [name for name in cameras[0] if name != gone]
    assert camera_set.warnings[1] == (
        f"1 of 7 photos are left out; the first: photo {gone} is not below photos, and its size is "
        "needed."
    )
    cameras[0][:] = [gone] * len(cameras[0])
    write_bundler(tmp_path, cameras)
    with pytest.raises(PhotoError, match="its size is needed"):
        read(tmp_path, photo_size=size)


@LENSES
@pytest.mark.parametrize("ours", ["colmap", "opensfm"])
def test_our_writers_are_read_again(tmp_path, lens, ours):
    cameras = flight(lens)
    if ours == "colmap":
        our_colmap.write_colmap(tmp_path, truth(cameras), origin=ORIGIN, offset=OFFSET)
    else:
        our_opensfm.write_opensfm(tmp_path, truth(cameras), origin=ORIGIN, offset=OFFSET[:2])
    assert_same_pixels(read(tmp_path).views, cameras, within_px=1e-6)


def test_pycolmap_reads_what_we_write(tmp_path):
    cameras = flight(BROWN)
    our_colmap.write_colmap(tmp_path, truth(cameras), origin=ORIGIN, offset=OFFSET)
    model = pycolmap.Reconstruction(str(tmp_path))
    points = ground()
    in_crs = points @ AXES + ORIGIN - OFFSET
    for view in truth(cameras):
        image = model.find_image_with_name(view.name)
        expected, depth_m = view.project(points)
        for point, pixel, depth in list(zip(in_crs, expected, depth_m, strict=True))[:50]:
            assert depth > 0
            assert image.project_point(point) == pytest.approx(pixel, abs=1e-5)


def test_writers_refuse_what_the_format_cannot_say(tmp_path):
    views = truth(flight(replace(BROWN, skew=1.0)))
    with pytest.raises(ValueError, match="skew"):
        our_colmap.write_colmap(tmp_path, views, origin=ORIGIN)
    with pytest.raises(ValueError, match="OpenSfM has no model"):
        our_opensfm.write_opensfm(tmp_path, views, origin=ORIGIN)
