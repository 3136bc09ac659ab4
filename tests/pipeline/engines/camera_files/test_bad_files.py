"""Cut, damaged, foreign and hostile files end in one error that names file and place."""

from __future__ import annotations

import json
import struct
from functools import partial

import numpy as np
import pytest
from pipeline.engines.camera_files.known_cameras import (
    BROWN,
    ORIGIN,
    SQUARE,
    UTM_15N,
    flight,
    ground,
    write_agisoft,
    write_bundler,
    write_colmap_binary,
    write_colmap_text,
    write_opensfm,
    write_pix4d,
    write_pix4d_external,
    write_shots_geojson,
)
from pipeline.engines.camera_files.known_exports import (
    write_blocks,
    write_nvm,
    write_omega_phi_kappa,
    write_rc_csv,
    write_xmp,
)

from terraport_pipeline.engines.camera_files import read_cameras
from terraport_pipeline.engines.camera_files.agisoft import read_agisoft
from terraport_pipeline.engines.camera_files.raw_cameras import MAX_CAMERAS
from terraport_pipeline.errors import PhotoError, ReadError


def read(path):
    return read_cameras(
        path, origin=ORIGIN, crs=UTM_15N, samples=ground(), photo_size=lambda _: (2000, 1125)
    )


def attempt(path):
    try:
        return read(path), ""
    except (ReadError, PhotoError) as error:
        return None, str(error)


def written(folder, kind):
    """Write one format; return the file that is to be damaged and the path to read."""
    cameras = flight(SQUARE if kind == "bundler" else BROWN)
    path = folder / "cameras.xml"
    if kind == "colmap text":
        write_colmap_text(folder, cameras)
        return folder / "images.txt", folder
    if kind == "colmap lenses":
        write_colmap_text(folder, cameras)
        return folder / "cameras.txt", folder
    if kind == "colmap binary":
        write_colmap_binary(folder, cameras)
        return folder / "images.bin", folder
    if kind == "opensfm":
        path = folder / "reconstruction.json"
        write_opensfm(path, cameras)
    elif kind == "shots":
        path = write_shots_geojson(folder, cameras)
    elif kind == "pix4d":
        path = write_pix4d(folder, cameras)
    elif kind == "external":
        path = write_pix4d_external(folder, cameras)
    elif kind == "agisoft":
        write_agisoft(path, cameras)
    elif kind == "nvm":
        path = write_nvm(folder, cameras, radial=-0.02, offset=(0.0, 0.0, 0.0))
    elif kind == "table":
        path = write_rc_csv(folder, cameras)
    elif kind == "sidecars":
        return write_xmp(folder, cameras) / "DJI_0003.xmp", folder
    elif kind == "blocks":
        write_blocks(path, cameras)
    elif kind == "angles":
        path = write_omega_phi_kappa(folder, cameras, "EPSG:32615")
    else:
        write_bundler(folder, cameras)
        path = folder / "bundle.out"
    return path, path


KINDS = (
    "colmap text", "colmap lenses", "colmap binary", "opensfm", "shots", "pix4d", "external",
    "agisoft", "bundler", "nvm", "table", "sidecars", "blocks", "angles",
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_cut_anywhere_is_an_error_or_fewer_cameras(tmp_path, kind):
    damaged, path = written(tmp_path, kind)
    whole = damaged.read_bytes()
    for end in np.linspace(0, len(whole) - 1, 25).astype(int):
        damaged.write_bytes(whole[:end])
        camera_set, message = attempt(path)
        # text that ends between two cameras, or in the last number, cannot be told
        assert len(message) < 1200 if camera_set is None else 1 <= len(camera_set.views) <= 6


@pytest.mark.parametrize("kind", KINDS)
def test_flipped_bytes_never_break_out(tmp_path, kind):
    damaged, path = written(tmp_path, kind)
    whole = damaged.read_bytes()
    rng = np.random.default_rng(11)
    for _ in range(30):
        data = bytearray(whole)
        for offset in rng.integers(0, len(whole), 3):
            data[offset] = rng.integers(0, 256)
        damaged.write_bytes(bytes(data))
        camera_set, message = attempt(path)
        assert camera_set or str(tmp_path) in message or "do not look at the cloud" in message


@pytest.mark.parametrize(
    ("kind", "old", "new", "message"),
    [
        ("colmap text", " 7 DJI_0003.JPG", " 8 DJI_0003.JPG", "line 8: DJI_0003.JPG has camera 8"),
        ("colmap text", "\n3 ", "\n3 nan ", "line 6"),
        ("colmap text", "DJI_0001.JPG", "DJI_0000.JPG", "'DJI_0000.JPG' has 2 poses"),
        ("colmap lenses", "FULL_OPENCV", "FOV", "line 2: the camera model is FOV"),
        ("colmap lenses", " 1457.1", " inf", "line 2: 'inf"),
        ("colmap lenses", " 1457.1", " -1457.1", "focal lengths above 0"),
        ("colmap lenses", "2000", "0", "0 x 1125 pixels"),
        ("opensfm", '"projection_type": "brown"', '"projection_type": "dual"', "'dual'"),
        ("opensfm", '"camera": "v2 dji"', '"camera": "other"', "shot 'DJI_0000.JPG'"),
        ("opensfm", '"rotation": [', '"rotation": [NaN, ', "finite numbers"),
        ("opensfm", '"shots"', '"images"', "without shots"),
        ("opensfm", '"width": 2000', '"width": null', "camera 'v2 dji'"),
        ("shots", '"width": 2000', '"width": 1000', "0 lenses of 1000 x 1125"),
        ("pix4d", " 2000 1125", " two 1125", "line 9: 'DJI_0000.JPG two 1125'"),
        ("pix4d", "0.014399", "nan", "radial distortion"),
        ("external", "DJI_0002.JPG ", "DJI_0002.JPG x", "line 4"),
        ("agisoft", '<sensor id="0"', '<sensor id="5"', "sensor '0' is not in the file"),
        ("agisoft", 'type="frame"', 'type="spherical"', "a spherical camera"),
        ("agisoft", "<k1>0.0144", "<k1>1e999", "k1: '1e999'"),
        ("agisoft", "<p1>", "<p3>0.1</p3><p1>", "the lens has p3"),
        ("agisoft", "<document", "<!DOCTYPE a><document", "document type"),
        ("agisoft", "<chunk", "<part", "no <chunk>|without a <chunk>|no XML"),
        ("bundler", "7 1\n", "7000000000 1\n", "7,000,000,000 cameras"),
        ("bundler", "7 1\n", "9 1\n", "9 cameras need as many names"),
        ("bundler", "7 1\n", "seven 1\n", "line 2: 'seven 1'"),
    ],
)
def test_the_error_names_the_place(tmp_path, kind, old, new, message):
    damaged, path = written(tmp_path, kind)
    text = damaged.read_text()
    assert old in text
    damaged.write_text(text.replace(old, new, 1))
    with pytest.raises(ReadError, match=message) as caught:
        read(path)
    assert str(damaged.parent if "2 poses" in message else damaged) in str(caught.value)


BOMB = """<?xml version="1.0"{encoding}?>
<!DOCTYPE document [
  <!ENTITY a "0123456789">
  <!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">
  <!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">
  <!ENTITY d "&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;">
  <!ENTITY e SYSTEM "file:///etc/hostname">
]>
<document><chunk label="&d;&e;"/></document>
"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1"])
def test_an_entity_bomb_is_refused_in_any_encoding(tmp_path, encoding):
    path = tmp_path / "cameras.xml"
    path.write_bytes(BOMB.replace("{encoding}", f' encoding="{encoding}"').encode(encoding))
    with pytest.raises(ReadError, match="document type"):
        read_agisoft(path)


@pytest.mark.parametrize("encoding", ["iso-88", "shift-jis", "utf-7"])
def test_an_encoding_that_is_not_known_is_refused(tmp_path, encoding):
    path = tmp_path / "cameras.xml"
    path.write_text(f'<?xml version="1.0" encoding="{encoding}"?><document/>')
    with pytest.raises(ReadError, match=r"no XML|without a <chunk>"):
        read_agisoft(path)


def test_binary_counts_are_bounded_before_anything_is_read(tmp_path):
    write_colmap_binary(tmp_path, flight(BROWN))
    images = tmp_path / "images.bin"
    whole = images.read_bytes()
    images.write_bytes(struct.pack("<Q", 2**60) + whole[8:])
    with pytest.raises(ReadError, match=f"at most {MAX_CAMERAS:,}"):
        read(tmp_path)
    # tie points that the file cannot hold
    at = whole.index(b"DJI_0000.JPG\0") + 13
    images.write_bytes(whole[:at] + struct.pack("<Q", 2**40) + whole[at + 8 :])
    with pytest.raises(ReadError, match=r"byte 8: DJI_0000.JPG should have 1,099,511,627,776"):
        read(tmp_path)


def test_deep_json_is_an_error(tmp_path):
    path = tmp_path / "reconstruction.json"
    path.write_text("[" * 100_000)
    with pytest.raises(ReadError, match="no JSON"):
        read(path)


def test_a_reference_must_be_a_place(tmp_path):
    path = tmp_path / "reconstruction.json"
    reference = {"latitude": 146.8, "longitude": -92.0, "altitude": 0.0}
    write_opensfm(path, flight(BROWN), reference=reference)
    with pytest.raises(ReadError, match="no place on Earth"):
        read(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "begins with"),
        (b"LASF\0\0", "b'LASF"),
        (b"<?xml version='1.0'?><Scene/>", "XML of another program"),
        (b"<?xml version='1.0'?><BlocksExchange/>", "0 blocks, expected one"),
        (b"{}", "without shots"),
        (json.dumps({"v2": {"projection_type": "brown"}}).encode(), "without shots"),
    ],
)
def test_other_files_are_named(tmp_path, content, message):
    path = tmp_path / "cameras.dat"
    path.write_bytes(content)
    with pytest.raises(ReadError, match=message):
        read(path)


def test_nothing_there(tmp_path):
    with pytest.raises(ReadError, match=r"no file of cameras is in this folder.*COLMAP"):
        read(tmp_path)
    with pytest.raises(ReadError, match="there is no such file"):
        read(tmp_path / "cameras.txt")
    write_colmap_text(tmp_path, flight(BROWN))
    (tmp_path / "cameras.txt").unlink()
    with pytest.raises(ReadError, match=r"cameras.txt is not beside it"):
        read(tmp_path / "images.txt")


def test_what_a_format_lacks_is_asked_for(tmp_path):
    write_bundler(tmp_path, flight(SQUARE))
    ask = partial(read_cameras, tmp_path / "bundle.out", origin=ORIGIN, crs=UTM_15N)
    with pytest.raises(PhotoError, match="--photos"):
        ask()
    write_pix4d_external(tmp_path / "pix4d", flight(BROWN))
    for cam in (tmp_path / "pix4d").glob("*.cam"):
        cam.unlink()
    with pytest.raises(ReadError, match=r"0 files .*calibrated_internal"):
        read(tmp_path / "pix4d")
    shots = write_shots_geojson(tmp_path / "odm", flight(BROWN))
    (tmp_path / "odm" / "cameras.json").unlink()
    with pytest.raises(ReadError, match=r"no cameras.json"):
        read(shots)
