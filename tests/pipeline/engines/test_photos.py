"""Photos: found by name, decoded once, bounded, damaged ones named."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from terraport_pipeline.engines import photo_store, photos
from terraport_pipeline.engines.photo_store import PhotoStore, photo_size
from terraport_pipeline.engines.photos import find_photos, open_photos
from terraport_pipeline.errors import PhotoError
from terraport_pipeline.geometry.photos.lens import Lens, View

LENS = Lens(64, 48, 50.0, 50.0, 32.0, 24.0)


def view(name, lens=LENS):
    return View(name, lens, np.eye(3), np.zeros(3))


def picture(size=(64, 48)):
    """A picture whose left is red, right is green, and top is dark."""
    width, height = size
    across, down = np.meshgrid(np.arange(width) / width, np.arange(height) / height)
    return np.stack([(1 - across) * 255, across * 255, down * 255], axis=-1).astype(np.uint8)


def save(path, size=(64, 48), **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture(size)).save(path, **options)
    return path


def test_names_match_without_case_and_in_folders(tmp_path):
    a = save(tmp_path / "flight1" / "dji_0001.jpg")
    b = save(tmp_path / "DJI_0002.png")
    paths = find_photos(tmp_path, [view("DJI_0001.JPG"), view("DJI_0002"), view("DJI_0003.JPG")])
    assert paths == {"DJI_0001.JPG": a, "DJI_0002": b}


def test_the_folders_of_a_name_decide_between_equal_names(tmp_path):
    save(tmp_path / "one" / "a.jpg")
    two = save(tmp_path / "two" / "a.jpg")
    assert find_photos(tmp_path, [view("two/a.jpg")]) == {"two/a.jpg": two}
    assert find_photos(tmp_path, [view("Two\\a.jpg")]) == {"Two\\a.jpg": two}
    with pytest.raises(PhotoError, match=r"photo a.jpg may be .*one/a.jpg or .*two/a.jpg"):
        find_photos(tmp_path, [view("a.jpg")])


@pytest.mark.parametrize(
    ("stored", "stated"),
    [
        ("Br\u00fcche_1.jpg", "Bru\u0308che_1.jpg"),
        ("Bru\u0308che_1.jpg", "BR\u00dcCHE_1.JPG"),
        ("\u1112\u1161\u11ab/a.jpg", "\ud55c/a.jpg"),
        ("C\u0327e\u0301.JPG", "\u00e7\u00e9"),
    ],
)
def test_accents_composed_and_decomposed_are_one_name(tmp_path, stored, stated):
    """macOS decomposes accents; other programs compose them."""
    path = save(tmp_path / stored)
    save(tmp_path / "other" / "a.jpg")
    assert find_photos(tmp_path, [view(stated)]) == {stated: path}


def test_of_names_that_differ_in_case_alone_the_stated_one_is_taken(tmp_path):
    lower, upper = save(tmp_path / "a.jpg"), save(tmp_path / "A.JPG")
    views = [view("a.jpg"), view("A.JPG")]
    assert find_photos(tmp_path, views) == {"a.jpg": lower, "A.JPG": upper}
    with pytest.raises(PhotoError, match="may be"):
        find_photos(tmp_path, [view("A.jpg")])


def test_no_photo_at_all_is_an_error_that_names_some(tmp_path):
    save(tmp_path / "other.jpg")
    with pytest.raises(PhotoError, match=r"none of the 2 photos .*a.jpg, b.jpg.*1 pictures"):
        find_photos(tmp_path, [view("a.jpg"), view("b.jpg")])
    with pytest.raises(PhotoError, match="is not a folder"):
        find_photos(tmp_path / "nothing", [view("a.jpg")])


def test_too_many_files_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(photos, "MAX_FILES", 3)
    for index in range(4):
        save(tmp_path / f"{index}.png")
    with pytest.raises(PhotoError, match="more than 3 files"):
        find_photos(tmp_path, [view("1.png")])


def test_missing_photos_leave_their_views_out(tmp_path):
    save(tmp_path / "a.png")
    opened = open_photos([view("a.png"), view("b.png")], tmp_path, max_bytes=1 << 20)
    assert [kept.name for kept in opened.views] == ["a.png"]
    assert len(opened.photos) == 1
    assert opened.warnings == (
        f"1 of 2 photos are not below {tmp_path} (b.png); they are left out.",
    )


def test_a_lens_is_scaled_to_the_stored_size(tmp_path):
    save(tmp_path / "a.png", (32, 24))
    opened = open_photos([view("a.png")], tmp_path, max_bytes=1 << 20)
    assert opened.views[0].lens == LENS.scaled(32, 24)
    assert "1 photos are stored at another size" in opened.warnings[0]


def test_another_aspect_is_refused(tmp_path):
    save(tmp_path / "a.png", (64, 64))
    with pytest.raises(PhotoError, match=r"64 x 64 pixels .*calibrated for 64 x 48"):
        open_photos([view("a.png")], tmp_path, max_bytes=1 << 20)


def exif(orientation):
    tags = Image.Exif()
    tags[0x0112] = orientation
    return tags


def test_exif_orientation_is_left_alone_while_the_sides_fit(tmp_path):
    save(tmp_path / "a.png", exif=exif(3))
    opened = open_photos([view("a.png")], tmp_path, max_bytes=1 << 20)
    assert (opened.photos.get(0) == picture()).all()


def test_exif_orientation_is_applied_where_only_the_turned_sides_fit(tmp_path):
    save(tmp_path / "a.png", (48, 64), exif=exif(6))
    opened = open_photos([view("a.png")], tmp_path, max_bytes=1 << 20)
    assert opened.views[0].lens == LENS
    assert (opened.photos.get(0) == np.rot90(picture((48, 64)), -1)).all()
    save(tmp_path / "a.png", (48, 64))
    with pytest.raises(PhotoError, match="EXIF orientation 1"):
        open_photos([view("a.png")], tmp_path, max_bytes=1 << 20)


@pytest.mark.parametrize("ending", ["png", "jpg", "webp", "tif"])
def test_pixels_and_scales(tmp_path, ending):
    size = (203, 151)
    options = {"quality": 95} if ending in ("jpg", "webp") else {}
    path = save(tmp_path / f"a.{ending}", size, **options)
    store = PhotoStore([path], 1 << 20)
    assert photo_size(path) == size
    whole = store.get(0)
    assert whole.shape == (151, 203, 3)
    assert not whole.flags.writeable
    assert np.abs(whole.astype(int) - picture(size)).mean() < 4
    for scale in (2, 4, 8):
        small = store.get(0, scale)
        assert small.shape == (-(-151 // scale), -(-203 // scale), 3)
        assert np.abs(small.mean(axis=(0, 1)) - whole.mean(axis=(0, 1))).max() < 3
    with pytest.raises(ValueError, match="a scale of"):
        store.get(0, 3)


@pytest.mark.parametrize("mode", ["L", "RGBA", "CMYK", "P"])
def test_other_kinds_of_pixels_become_rgb(tmp_path, mode):
    path = tmp_path / "a.tif"
    Image.fromarray(picture()).convert(mode).save(path)
    assert PhotoStore([path], 1 << 20).get(0).shape == (48, 64, 3)


def test_sixteen_bits_are_refused(tmp_path):
    path = tmp_path / "a.tif"
    Image.fromarray(np.zeros((48, 64), np.uint16)).save(path)
    with pytest.raises(PhotoError, match=r"pixels of kind I;16.*as JPEG"):
        PhotoStore([path], 1 << 20).get(0)


def test_the_least_lately_used_photo_is_dropped(tmp_path, monkeypatch):
    paths = [save(tmp_path / f"{index}.png") for index in range(3)]
    decoded = []
    real = photo_store._decode
    monkeypatch.setattr(
        photo_store, "_decode", lambda path, *rest: decoded.append(path) or real(path, *rest)
    )
    store = PhotoStore({path.name: path for path in paths}, 2 * 64 * 48 * 3)
    for index in (0, 1, 0, 2, 0, 1):
        store.get(index)
        assert store.kept_bytes <= store.max_bytes
    assert decoded == [paths[0], paths[1], paths[2], paths[1]]


def test_a_photo_beyond_the_bound_is_handed_out_and_not_kept(tmp_path):
    store = PhotoStore([save(tmp_path / "a.png")], 100)
    assert store.get(0).shape == (48, 64, 3)
    assert store.kept_bytes == 0


def test_threads_decode_a_photo_once(tmp_path, monkeypatch):
    path = save(tmp_path / "a.png")
    decoded = []
    gate = threading.Event()
    real = photo_store._decode

    def slow(*arguments):
        decoded.append(arguments)
        gate.wait(10)
        return real(*arguments)

    monkeypatch.setattr(photo_store, "_decode", slow)
    store = PhotoStore([path], 1 << 20)
    images = []
    threads = [threading.Thread(target=lambda: images.append(store.get(0))) for _ in range(6)]
    for thread in threads:
        thread.start()
    gate.set()
    for thread in threads:
        thread.join(10)
    assert len(images) == 6
    assert len(decoded) == 1
    assert all(photo is images[0] for photo in images)


def test_a_failed_decoding_is_tried_again_by_the_next(tmp_path):
    path = save(tmp_path / "a.jpg", (200, 150))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    store = PhotoStore([path], 1 << 20)
    for _ in range(2):
        with pytest.raises(PhotoError, match=r"photo .*a.jpg cannot be read"):
            store.get(0)
    path.write_bytes(whole)
    assert store.get(0).shape == (150, 200, 3)


def test_what_is_no_picture_is_named(tmp_path):
    path = tmp_path / "a.jpg"
    path.write_bytes(b"no picture")
    with pytest.raises(PhotoError, match=r"a.jpg cannot be read .*copy it again"):
        photo_size(path)


def test_a_picture_of_too_many_pixels_is_not_decoded(tmp_path, monkeypatch):
    monkeypatch.setattr(photo_store, "MAX_PIXELS", 1000)
    save(tmp_path / "a.png")
    with pytest.raises(PhotoError, match="64 x 48 pixels, expected at most 1,000"):
        open_photos([view("a.png")], tmp_path, max_bytes=1 << 20)


def test_real_photos(shared_data):
    folder = shared_data / "brighton_beach" / "images"
    lens = replace(LENS, width=2000, height=1125)
    opened = open_photos([view("dji_0018.jpg", lens)], folder, max_bytes=64 << 20)
    assert opened.photos.get(0, 8).shape == (141, 250, 3)
    assert opened.photos.get(0).shape == (1125, 2000, 3)
