"""Exports of OpenDroneMap, VisualSFM, RealityCapture, ContextCapture and Metashape's text."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from pipeline.engines.camera_files.known_cameras import (
    BROWN,
    HEIGHT,
    OFFSET,
    ORIGIN,
    SQUARE,
    UTM_15N,
    WIDTH,
    assert_same_pixels,
    flight,
    ground,
    truth,
    write_agisoft,
    write_bundler,
    write_colmap_binary,
    write_colmap_text,
    write_opensfm,
)
from pipeline.engines.camera_files.known_exports import (
    RC_HEADING,
    RS_HEADING,
    write_blocks,
    write_nvm,
    write_omega_phi_kappa,
    write_rc_csv,
    write_xmp,
)
from pipeline.engines.camera_files.test_formats import (
    a_place,
    assert_pixels,
    enu_to_ecef,
    moved_flight,
    scene_truth,
)
from pyproj import CRS, Transformer

from terraport_pipeline.engines.camera_files import has_cameras, read_cameras, read_raw_cameras
from terraport_pipeline.errors import PhotoError, ReadError

EVEN = replace(BROWN, fy=BROWN.fx)


def read(path, size=(WIDTH, HEIGHT), **options):
    arguments = {
        "origin": ORIGIN,
        "crs": UTM_15N,
        "samples": ground(),
        "photo_size": lambda _: size,
        **options,
    }
    return read_cameras(path, **arguments)


def without_ending(cameras):
    names, turns, centres, lens = cameras
    return [name.removesuffix(".JPG") for name in names], turns, centres, lens


# --- OpenDroneMap's Bundler file --------------------------------------------------------------


def odm_bundle(folder, cameras):
    """``opensfm/`` of a project: the bundle, its list, the offset above."""
    opensfm = folder / "opensfm"
    write_bundler(opensfm, cameras)
    (opensfm / "bundle.out").rename(opensfm / "bundle_r000.out")
    (opensfm / "list.txt").unlink()
    (opensfm / "OFFSET.txt").unlink()
    (opensfm / "list_r000.out").write_text("\n".join([*cameras[0], "DJI_9999.JPG"]) + "\n")
    (folder / "odm_georeferencing").mkdir()
    (folder / "odm_georeferencing" / "odm_georeferencing_model_geo.txt").write_text(
        "WGS84 UTM 15N\n576600 5188100\n"
    )
    return opensfm


@pytest.mark.parametrize("given", ["opensfm/bundle_r000.out", "opensfm", "."])
def test_opendronemaps_bundle_finds_its_own_list(tmp_path, given):
    cameras = flight(SQUARE)
    odm_bundle(tmp_path, cameras)
    camera_set = read(tmp_path / given)
    assert_same_pixels(camera_set.views, cameras)
    assert "odm_georeferencing_model_geo.txt" in camera_set.frame


def test_opensfm_says_the_size_that_its_focal_lengths_are_of(tmp_path):
    cameras = flight(SQUARE)
    opensfm = odm_bundle(tmp_path, cameras)
    models = {"v2 dji": {"width": WIDTH, "height": HEIGHT, "focal": 0.7}}
    (opensfm / "camera_models.json").write_text(json.dumps(models))
    camera_set = read(opensfm, size=(2 * WIDTH, 2 * HEIGHT))
    assert_same_pixels(camera_set.views, cameras)


def test_a_bundle_without_its_list_names_the_lists(tmp_path):
    opensfm = odm_bundle(tmp_path, flight(SQUARE))
    (opensfm / "list_r000.out").unlink()
    with pytest.raises(ReadError, match=r"no list.txt, list_r000.out, .* or one folder above"):
        read(opensfm)
    (opensfm / "list.txt").write_text("only.JPG\n")
    with pytest.raises(ReadError, match=r"7 cameras need as many names \(.*list.txt has 1\)"):
        read(opensfm)


def test_undistorted_photos_have_cameras_of_their_own(tmp_path):
    names, turns, centres, lens = flight(replace(BROWN, radial=(), tangential=(0.0, 0.0)))
    undistorted = tmp_path / "opensfm" / "undistorted"
    write_opensfm(undistorted / "reconstruction.json", (names, turns, centres, lens))
    write_opensfm(tmp_path / "opensfm" / "reconstruction.json", flight(BROWN))
    (undistorted / "images").mkdir()
    for name in names:
        (undistorted / "images" / f"{name}.tif").touch()
    (tmp_path / "odm_georeferencing").mkdir()
    (tmp_path / "odm_georeferencing" / "coords.txt").write_text("WGS84 UTM 15N\n576600 5188100\n")
    camera_set = read(undistorted)
    assert "coords.txt" in camera_set.frame
    stored = [f"{name}.tif" for name in names], turns, centres, lens
    assert_same_pixels(camera_set.views, stored)
    assert_same_pixels(read(tmp_path).views, flight(BROWN))


# --- VisualSFM ----------------------------------------------------------------------------------


def vsfm_pixels(lens, points, radial):
    """VisualSFM's own formula: the measured m with (1 + r m^2) m where the ideal point is."""
    ideal = points[:, :2] / points[:, 2:]
    length = np.linalg.norm(ideal, axis=1)
    roots = [np.roots([radial, 0.0, 1.0, -value]) for value in length]
    measured = np.array(
        [
            min((r.real for r in three if abs(r.imag) < 1e-9 and r.real >= 0), default=np.nan)
            for three in roots
        ]
    )
    return ideal * (measured / length)[:, None] * lens.fx + (lens.cx, lens.cy)


@pytest.mark.parametrize("radial", [-0.08, 0.05])
def test_nvm_distorts_from_the_photo_to_the_ray(tmp_path, radial):
    cameras = flight(replace(SQUARE, radial=()))
    write_nvm(tmp_path, cameras, radial)
    camera_set = read(tmp_path)
    assert camera_set.format == "NVM"
    compared = 0
    for view, known in zip(camera_set.views, truth(cameras), strict=True):
        points = ground()
        local = (points - known.position) @ known.rotation.T
        expected = vsfm_pixels(known.lens, local, radial)
        inside = (np.abs(expected - (1000, 562)) < (1000, 562)).all(axis=1)
        assert np.abs(view.project(points)[0] - expected)[inside].max() < 0.01
        compared += int(inside.sum())
    assert compared > 1000
    # the other sign is off by many pixels: it would not pass for right
    write_nvm(tmp_path, cameras, -radial)
    other = read(tmp_path).views[0]
    corner = np.array([[2.0, 2.0]])
    assert (
        np.abs(other.lens.project(camera_set.views[0].lens.unproject(corner)) - corner).max() > 10.0
    )


def test_nvm_names_and_further_models(tmp_path):
    cameras = flight(replace(SQUARE, radial=()))
    path = write_nvm(tmp_path, cameras, blanks=True)
    assert read(path).views[0].name == "flight 1/DJI_0000.JPG"
    assert read(path).warnings == ()
    text = path.read_text()
    again = text[text.index("\n6\n") : text.index("\n1\nlost")]
    path.write_text(text.replace("\n1\nlost", f"{again}\n1\nlost"))
    assert read(path).warnings == (
        "flight.nvm holds 2 models that were not joined; only the first is used.",
    )


@pytest.mark.parametrize("cx", [1010.5, 10.5])
def test_nvm_with_one_lens_for_all(tmp_path, cx):
    cameras = flight(replace(SQUARE, fy=1454.0, cx=1010.5, cy=550.25, radial=()))
    cy = 550.25 if cx > 1000 else 550.25 - 562.5
    write_nvm(tmp_path, cameras, heading=f"NVM_V3 FixedK 1457.1 {cx} 1454.0 {cy} 0")
    assert_same_pixels(read(tmp_path).views, cameras)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("NVM_V3", "NVM_V3 FixedK 1 2", "is no heading NVM_V3"),
        ("\n6\n", "\nsix\n", "'six' is not a count of cameras"),
        ("\n6\n", "\n9\n", "is no camera"),
        (" 0\nDJI_0001", "\nDJI_0001", "line 4: .*is no camera"),
        (" 0.05 0\nDJI_0001", " -3.0 0\nDJI_0001", "folds the picture's corners"),
    ],
)
def test_a_damaged_nvm_names_the_line(tmp_path, old, new, message):
    path = write_nvm(tmp_path, flight(replace(SQUARE, radial=())), radial=0.05)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ReadError, match=message):
        read(path)


# --- RealityCapture -----------------------------------------------------------------------------


@pytest.mark.parametrize("heading", [RC_HEADING, RS_HEADING])
def test_realitycaptures_table(tmp_path, heading):
    cameras = flight(EVEN)
    write_rc_csv(tmp_path, cameras, heading)
    camera_set = read(tmp_path)
    assert camera_set.format == "RealityCapture CSV"
    assert_same_pixels(camera_set.views, cameras)


def test_a_row_as_realitycapture_wrote_it(tmp_path):
    """A video of a monument, 3840 x 2880: near the horizon, to the south, tipped by 23 degrees."""
    (tmp_path / "schliemann.csv").write_text(
        f"{RC_HEADING}\nframe_00001.jpeg,44.5876747664166,138.823621534044,6.821916401534405,"
        "170.3483067926429,85.18637269312288,-22.74995074830745,14.2390682243052,"
        "-9.482184385774318e-004,-2.446553068050568e-004,3.114799768048152e-003,"
        "4.026391718074555e-003,-1.795976992379612e-003,0,0,0\n"
    )
    (camera,) = read_raw_cameras(tmp_path, lambda _: (3840, 2880)).cameras
    assert camera.name == "frame_00001.jpeg"
    assert camera.lens.fx == pytest.approx(1518.834, abs=1e-3)
    assert camera.lens.cx == pytest.approx(1916.359, abs=1e-3)
    right, down, forward = camera.rotation
    # looks some degrees below the horizon, and its up stays nearly level with the sky's
    assert abs(forward[2]) < 0.15
    assert -down @ (np.sin(np.radians(170.348)), np.cos(np.radians(170.348)), 0.0) == (
        pytest.approx(np.cos(np.radians(85.186)), abs=1e-4)
    )
    assert right @ down == pytest.approx(0.0, abs=1e-12)


def test_realitycaptures_table_in_degrees(tmp_path):
    names, turns, centres, lens = local = moved_flight(EVEN)
    crs, origin, scene, pixels = scene_truth(local)
    degrees, own_turns = to_degrees(turns, centres)
    write_rc_csv(tmp_path, (names, own_turns, centres, lens), positions=degrees)
    camera_set = read(tmp_path, origin=origin, crs=crs, samples=scene)
    assert "degrees and metres (WGS 84)" in camera_set.frame
    assert_pixels(camera_set.views, scene, pixels)


def to_degrees(turns, centres):
    """Longitude, latitude, height of each centre, and the turns against its own east, north, up."""
    turn, centre = enu_to_ecef(46.8, -92.0, 0.0)
    to_geodetic = Transformer.from_crs(4978, 4979, always_xy=True)
    degrees = np.column_stack(to_geodetic.transform(*(centres @ turn.T + centre).T))
    own = [
        one @ turn.T @ enu_to_ecef(latitude, longitude, height)[0]
        for one, (longitude, latitude, height) in zip(turns, degrees, strict=True)
    ]
    return degrees, np.array(own)


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), OFFSET])
def test_realitycaptures_sidecars(tmp_path, offset):
    cameras = flight(BROWN)
    write_xmp(tmp_path, cameras, offset)
    if any(offset):
        (tmp_path / "OFFSET.txt").write_text("{} {} {}\n".format(*offset))
    camera_set = read(tmp_path)
    assert camera_set.format == "RealityCapture XMP"
    assert_same_pixels(camera_set.views, without_ending(cameras))
    assert camera_set.warnings == ("1 XMP files hold no pose; their photos are left out.",)


def test_sidecars_beside_the_photos_of_several_folders(tmp_path):
    cameras = flight(EVEN)
    write_xmp(tmp_path / "images" / "100MEDIA", cameras)
    (tmp_path / "images" / "any.xmp").write_text(
        (tmp_path / "images" / "100MEDIA" / "DJI_9998.xmp").read_text()
    )
    assert has_cameras(tmp_path / "images")
    views = read(tmp_path / "images").views
    assert views[0].name == "100MEDIA/DJI_0000"


def test_sidecars_stand_behind_any_other_file(tmp_path):
    cameras = flight(EVEN)
    write_xmp(tmp_path, flight(SQUARE))
    write_rc_csv(tmp_path, cameras)
    assert read(tmp_path).format == "RealityCapture CSV"


def test_portrait_photos_count_from_their_longer_side(tmp_path):
    (tmp_path / "a.csv").write_text(
        "#name,x,y,alt,heading,pitch,roll,f,px,py\na.jpg,1,2,3,0,0,0,18,0.01,-0.02\n"
    )
    (camera,) = read_raw_cameras(tmp_path, lambda _: (3000, 4000)).cameras
    lens = camera.lens
    assert (lens.fx, lens.fy, lens.cx, lens.cy) == pytest.approx((2000, 2000, 1540, 1920))


@pytest.mark.parametrize(
    ("model", "terms", "message"),
    [
        ("division", "-0.05 0 0 0 0 0", "a lens of the model 'division'.*Brown3"),
        ("brown3", "0.1 nan 0 0 0 0", "finite numbers"),
        ("brown3", "0.1 0 0", "6 finite numbers"),
    ],
)
def test_lenses_of_sidecars_that_are_not_understood(tmp_path, model, terms, message):
    folder = write_xmp(tmp_path, flight(EVEN), model=model)
    path = folder / "DJI_0000.xmp"
    text = path.read_text()
    start, end = text.index("<xcr:DistortionC"), text.index("</xcr:DistortionC")
    path.write_text(f"{text[:start]}<xcr:DistortionCoeficients>{terms}{text[end:]}")
    with pytest.raises(ReadError, match=message):
        read(folder)


def test_a_division_lens_without_distortion_is_a_pinhole(tmp_path):
    cameras = flight(replace(EVEN, radial=(), tangential=(0.0, 0.0)))
    assert_same_pixels(
        read(write_xmp(tmp_path, cameras, model="division")).views, without_ending(cameras)
    )


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("a.jpg,1,2,3,0,0,0,18,0,0,-0.1,0,0,0,0,0", "line 2: k1 alone: a lens of the Division"),
        ("a.jpg,1,2,3,0,0,0,18,0,0", "line 2: 10 values for 16 columns"),
        ("a.jpg,1,2,3,0,0,nan,18,0,0,0,0,0,0,0,0", "line 2: .*finite numbers"),
        ("a.jpg,1,2,3,0,0,0,-18,0,0,0,0,0,0,0,0", "focal lengths above 0"),
        ("", "no camera in it has a pose"),
    ],
)
def test_rows_that_are_not_understood(tmp_path, row, message):
    (tmp_path / "a.csv").write_text(f"{RC_HEADING}\n{row}\n")
    with pytest.raises(ReadError, match=message):
        read(tmp_path)


# --- Blocks Exchange ----------------------------------------------------------------------------


@pytest.mark.parametrize("axes", ["XRightYDown", "XRightYUp", "XUpYRight"])
@pytest.mark.parametrize("in_pixels", [True, False])
def test_blocks_exchange(tmp_path, axes, in_pixels):
    cameras = flight(BROWN)
    write_blocks(tmp_path / "block.xml", cameras, axes=axes, in_pixels=in_pixels)
    camera_set = read(tmp_path)
    assert camera_set.format == "Blocks Exchange"
    assert camera_set.warnings == ("1 photos have no pose in block.xml; they are left out.",)
    names, *others = cameras
    assert_same_pixels(camera_set.views, ([f"D:/flight/{name}" for name in names], *others))


def test_blocks_exchange_in_degrees(tmp_path):
    names, turns, centres, lens = local = moved_flight(BROWN)
    crs, origin, scene, pixels = scene_truth(local)
    degrees, own_turns = to_degrees(turns, centres)
    path = tmp_path / "block.xml"
    write_blocks(path, (names, own_turns, centres, lens), "EPSG:4979", positions=degrees)
    camera_set = read(path, origin=origin, crs=crs, samples=scene)
    assert_pixels(
        [replace(view, name=view.name.rpartition("/")[2]) for view in camera_set.views],
        scene,
        pixels,
    )


def test_blocks_exchange_about_a_place(tmp_path):
    local = moved_flight(BROWN)
    crs, origin, scene, pixels = scene_truth(local)
    path = write_blocks(tmp_path / "block.xml", local, "ENU:46.8,-92.0")
    camera_set = read(path, origin=origin, crs=crs, samples=scene)
    assert "metres about 46.800000, -92.000000" in camera_set.frame
    assert_pixels(
        [replace(view, name=view.name.rpartition("/")[2]) for view in camera_set.views],
        scene,
        pixels,
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (">Perspective<", ">Fisheye<", "a Fisheye camera, expected Perspective"),
        (">XRightYDown<", ">XRightYLeft<", "the camera's axes are 'XRightYLeft'"),
        ("M_12>", "M_99>", "a rotation without its matrix; export rotations as matrices"),
        ("<K1>", "<K4>0.1</K4><K1>", "the lens has K4"),
        ("<Block>", "<Block></Block><Block>", "2 blocks, expected one"),
        ("<FocalLengthPixels>1457.1</FocalLengthPixels>", "", "P4, FocalLength: '' is not 1"),
    ],
)
def test_blocks_that_are_not_understood(tmp_path, old, new, message):
    path = write_blocks(tmp_path / "block.xml", flight(BROWN))
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ReadError, match=message):
        read(path)


# --- Metashape ----------------------------------------------------------------------------------


def test_omega_phi_kappa_with_the_calibration(tmp_path):
    cameras = flight(BROWN)
    path = write_omega_phi_kappa(tmp_path, cameras, CRS.from_epsg(32615).to_wkt("WKT1_GDAL"))
    for given in (path, tmp_path):
        camera_set = read(given)
        assert camera_set.format == "Omega Phi Kappa"
        assert_same_pixels(camera_set.views, without_ending(cameras))
    (tmp_path / "calibration.xml").unlink()
    with pytest.raises(ReadError, match=r"\(\*.xml\) none is beside it, .* as Agisoft XML"):
        read(path)


def test_omega_phi_kappa_whose_matrix_is_another(tmp_path):
    path = write_omega_phi_kappa(tmp_path, flight(BROWN), "EPSG:32615")
    lines = path.read_text().splitlines()
    words = lines[3].split("\t")
    words[6] = str(float(words[6]) + 1.0)
    path.write_text("\n".join([*lines[:3], "\t".join(words), *lines[4:]]))
    with pytest.raises(ReadError, match="line 4: the matrix is not that of the angles"):
        read(path)


def test_metashape_says_what_it_leaves_out(tmp_path):
    path = tmp_path / "cameras.xml"
    write_agisoft(path, flight(BROWN))
    text = path.read_text()
    path.write_text(
        text.replace(
            '<camera id="9" sensor_id="0"', '<camera id="9" sensor_id="1" master_id="8"'
        ).replace("<calibration ", '<property name="rolling_shutter" value="true"/><calibration ')
    )
    first, second = read(path, offset=OFFSET).warnings
    assert first.startswith("1 photos of other lenses or bands of a multi-camera system")
    assert "rolling shutter" in second


def grouped(path, labels):
    """Cameras one after the other, each in the groups whose labels its own begins with."""
    write_agisoft(path, flight(BROWN))
    text = path.read_text()
    cameras = re.findall('<camera id="1".*?</camera>', text)
    for number, (camera, label) in enumerate(zip(cameras, labels, strict=True)):
        *groups, own = label.split("|")
        opened = "".join(f'<group id="{number}" label="{name}" type="folder">' for name in groups)
        named = re.sub(' label="[^"]*"', f' label="{own}"', camera)
        text = text.replace(camera, opened + named + "</group>" * len(groups), 1)
    path.write_text(text)
    return path


def test_metashapes_groups_tell_equal_labels_apart(tmp_path):
    """Drones number the photos of every folder from 1."""
    labels = ["101|a", "101|b", "102|a", "deep|102|b", "102|c", "d"]
    raw = read_raw_cameras(grouped(tmp_path / "cameras.xml", labels))
    names = [camera.name for camera in raw.cameras]
    assert names == ["flight/101/a", "flight/101/b", "flight/102/a", "flight/deep/102/b", "c", "d"]
    labels[1] = "101|a"
    with pytest.raises(ReadError, match=r"photo 'flight/101/a' has 2 poses, .*several folders"):
        read_raw_cameras(grouped(tmp_path / "cameras.xml", labels))


def test_metashapes_further_chunks_are_told(tmp_path):
    path = tmp_path / "cameras.xml"
    write_agisoft(path, flight(BROWN))
    text = path.read_text()
    chunk = text[text.index("<chunk") : text.index("</chunk>") + len("</chunk>")]
    path.write_text(text.replace(chunk, chunk + chunk.replace("DJI", "IMG")))
    [told] = [one for one in read_raw_cameras(path).warnings if "chunks" in one]
    assert "holds 2 chunks; only" in told
    assert "with 6 photos is used" in told


# --- Which file -----------------------------------------------------------------------------------


def test_a_folder_of_two_alignments_is_refused_with_their_names(tmp_path):
    cameras = flight(SQUARE)
    write_colmap_text(tmp_path / "colmap", cameras)
    write_bundler(tmp_path, cameras)
    with pytest.raises(ReadError, match=r"2 files .*\(colmap/cameras.txt, bundle.out\).*--cameras"):
        read(tmp_path)
    write_agisoft(tmp_path / "b" / "first.xml", cameras)
    write_agisoft(tmp_path / "b" / "second.xml", cameras)
    with pytest.raises(ReadError, match=r"2 files .*\(first.xml, second.xml\)"):
        read(tmp_path / "b")
    assert read(tmp_path / "bundle.out").format == "Bundler"


def some(cameras, *rows):
    names, turns, centres, lens = cameras
    return [[column[row] for row in rows] for column in (names, turns, centres)] + [lens]


@pytest.mark.parametrize("place", ["", "sparse", "colmap/sparse"])
@pytest.mark.parametrize("write", [write_colmap_text, write_colmap_binary])
def test_colmaps_further_models_are_told_with_their_photos(tmp_path, place, write):
    """One model for every set of photos that COLMAP could not join; some photos are in two."""
    cameras = flight(SQUARE)
    folder = tmp_path / place
    write(folder / "0", some(cameras, 0, 1, 2))
    write_colmap_text(folder / "2", some(cameras, 2, 3))
    write_colmap_binary(folder / "10", some(cameras, 4, 5))
    raw = read_raw_cameras(tmp_path)
    assert [camera.name for camera in raw.cameras] == cameras[0][:3]
    [text] = raw.warnings
    assert "Of COLMAP's 3 models only" in text
    assert (
        "0 is used, with 3 photos (2 has 2 photos, 1 of them only there; 10 has 2 photos, 2" in text
    )
    assert read_raw_cameras(folder / "2").warnings == ()  # named, so meant
    (folder / "10" / "images.bin").write_bytes(b"")
    assert "10 cannot be read: the file ends" in read_raw_cameras(tmp_path).warnings[0]
    shutil.rmtree(folder / "0")
    assert "2 is used, with 2 photos" in read_raw_cameras(tmp_path).warnings[0]


def test_cameras_elsewhere_are_told_how_to_be_exported(tmp_path):
    for write, words in (
        (lambda folder: write_rc_csv(folder, flight(EVEN), offset=OFFSET), "Project output"),
        (lambda folder: write_xmp(folder, flight(EVEN), offset=OFFSET), "Internal/External"),
        (lambda folder: write_agisoft(folder / "c.xml", flight(BROWN)), "Reference > Settings"),
    ):
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        write(folder)
        with pytest.raises(PhotoError, match=words):
            read(folder)


def test_survey_without_a_system_takes_the_files_own_coordinates(tmp_path):
    cameras = flight(BROWN)
    path = write_blocks(tmp_path / "block.xml", cameras)
    assert "own coordinates" in read(path, crs=None).frame
    crs, _ = a_place()
    assert crs.wkt
