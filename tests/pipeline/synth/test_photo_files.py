from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from terraport_pipeline.engines.camera_files import read_cameras
from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.synth import photo_files as module
from terraport_pipeline.synth.options import FlightOptions, QuarryOptions
from terraport_pipeline.synth.photo_files import develop, exposures, write_photos

QUARRY = QuarryOptions(points=1_000, seed=7, size_m=90.0, detail=1.0)
FLIGHT = FlightOptions(count=4, width=160, height=120)


def digest(folder: Path) -> dict[str, str]:
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    photo_set = tmp_path_factory.mktemp("photos") / "set"
    written = write_photos(QUARRY, FLIGHT, photo_set, survey="q.laz")
    assert written.photos == 4
    assert written.truck_photos >= 2
    assert written.bytes > 10_000
    return photo_set


def test_everything_is_there_and_fits_together(folder: Path) -> None:
    names = [f"DJI_000{n}" for n in (1, 2, 3, 4)]
    assert sorted(file.stem for file in (folder / "images").iterdir()) == names
    truth = json.loads((folder / "truth" / "photos.json").read_text())
    assert [row["name"] for row in truth["photos"]] == [f"{name}.JPG" for name in names]
    views = read_cameras(folder / "colmap", origin=np.array(truth["origin"]), crs=None).views
    shown = [row for row in truth["photos"] if row["truck"]]
    for row in shown:
        mask = np.asarray(Image.open(folder / "truth/masks" / row["name"].replace("JPG", "png")))
        assert mask.shape == (120, 160)
        assert (mask == 255).sum() == row["truck"]["pixels"]
        view = next(view for view in views if view.name == row["name"])
        e, n, h = np.array(row["truck"]["position"]) - truth["origin"]
        (column, line), _ = (projected[0] for projected in view.project(np.array([[e, h, -n]])))
        x0, y0, x1, y1 = row["truck"]["box_px"]
        assert x0 - 3 <= column <= x1 + 3
        assert y0 - 3 <= line <= y1 + 3


def test_the_same_options_give_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    write_photos(QUARRY, FLIGHT, tmp_path / "again", survey="q.laz", threads=1)
    assert digest(tmp_path / "again") == digest(folder)


def test_a_folder_that_is_there_stays(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="exists already"):
        write_photos(QUARRY, FLIGHT, folder)
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "holiday.jpg").write_bytes(b"x")
    with pytest.raises(OptionError, match="no folder of synthetic photos"):
        write_photos(QUARRY, FLIGHT, mine, overwrite=True)
    assert (mine / "holiday.jpg").is_file()
    with pytest.raises(OptionError, match="no such folder"):
        write_photos(QUARRY, FLIGHT, tmp_path / "none" / "photos")


def test_a_failure_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "_write_mask", fail)
    with pytest.raises(ResourceError, match="nothing was left behind"):
        write_photos(QUARRY, FLIGHT, tmp_path / "photos")
    assert list(tmp_path.iterdir()) == []


def test_exposures_drift_within_their_bound() -> None:
    gains = exposures(FlightOptions(count=400, exposure_drift_ev=0.4), 1)
    stops = np.log2(gains[:, 1])
    assert np.abs(stops).max() <= 0.4 + 1e-9
    assert stops.std() > 0.1
    assert np.corrcoef(stops[1:], stops[:-1])[0, 1] > 0.4  # a drift, not noise
    np.testing.assert_array_equal(exposures(FlightOptions(count=3, exposure_drift_ev=0.0), 1), 1.0)


def test_a_camera_without_errors_stores_what_it_sees() -> None:
    perfect = FlightOptions(vignetting=0.0, sensor_noise=0.0)
    scene = np.random.default_rng(0).integers(0, 256, (20, 30, 3)).astype(np.float32)
    np.testing.assert_array_equal(develop(scene, np.ones(3), perfect, 0), scene.astype(np.uint8))


def test_exposure_vignetting_and_noise_do_what_they_say() -> None:
    grey = np.full((200, 300, 3), 128.0, dtype=np.float32)
    plain = FlightOptions(vignetting=0.0, sensor_noise=0.0)
    # Twice the light: 128 is 0.2159 linear, 0.4317 is 175.9.
    assert np.unique(develop(grey, np.full(3, 2.0), plain, 0)).tolist() == [176]
    dark = develop(grey, np.ones(3), FlightOptions(vignetting=0.5, sensor_noise=0.0), 0)
    assert dark[100, 150, 0] == 128
    assert dark[0, 0, 0] == 93  # half the light
    noisy = develop(grey, np.ones(3), FlightOptions(vignetting=0.0, sensor_noise=3.0), 5)
    assert noisy.std() == pytest.approx(3.0, rel=0.05)
    assert noisy.mean() == pytest.approx(128.0, abs=0.1)
    other = develop(grey, np.ones(3), FlightOptions(vignetting=0.0, sensor_noise=3.0), 6)
    assert abs(np.corrcoef(noisy.ravel(), other.ravel())[0, 1]) < 0.02


def test_no_truck_stands_below_a_drone_that_follows_the_way(tmp_path: Path) -> None:
    flight = FlightOptions(count=6, width=160, height=120, way_share=0.5)
    write_photos(QUARRY, flight, tmp_path / "set", survey="q.laz")
    truth = json.loads((tmp_path / "set" / "truth" / "photos.json").read_text())
    assert [row["truck"] for row in truth["photos"][3:]] == [None] * 3
    assert any(row["truck"] for row in truth["photos"][:3])
