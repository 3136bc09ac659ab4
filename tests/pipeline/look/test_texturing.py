from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from terraport_pipeline.engines.cameras import Camera
from terraport_pipeline.engines.pictures import Tint, render_mesh
from terraport_pipeline.engines.texturing import (
    ImageCache,
    Texturing,
    bilinear,
    decode_halved,
)
from terraport_pipeline.errors import EngineError

# A plate of two triangles, 2 x 2 m, seen from straight above: u runs east, v south.
PLATE = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], dtype=np.float32)
FACES = np.array([[0, 2, 1], [0, 3, 2]], dtype=np.int32)
UVS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
ABOVE = Camera("orthographic", (0, 5, 0), (1, 0, 0), (0, 0, -1), (0, -1, 0), 1.0)


def file_of(pixels: np.ndarray, kind: str = "PNG") -> bytes:
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, kind, quality=95)
    return out.getvalue()


def cache_of(*images: np.ndarray, max_bytes: int = 1 << 20) -> tuple[ImageCache, list[int]]:
    read: list[int] = []
    files = [file_of(image) for image in images]

    def get(number: int) -> bytes:
        read.append(number)
        return files[number]

    sizes = [(image.shape[1], image.shape[0]) for image in images]
    return ImageCache(get, dict(enumerate(sizes)), max_bytes), read


QUARTERS = np.zeros((64, 64, 3), dtype=np.uint8)
QUARTERS[:32, :32] = (250, 10, 10)
QUARTERS[:32, 32:] = (10, 250, 10)
QUARTERS[32:, :32] = (10, 10, 250)


def test_a_texture_stands_as_gltf_says() -> None:
    """(0, 0) is the image's upper left."""
    images, _ = cache_of(QUARTERS)
    texturing = Texturing(UVS, np.zeros(2, np.int32), images)
    picture = render_mesh(
        PLATE, FACES, ABOVE, (64, 64), texturing=texturing, relief=0.0, shadows=False
    )
    inner = np.zeros((64, 64), dtype=bool)
    inner[2:30, 2:30] = inner[2:30, 34:62] = inner[34:62, 2:30] = True
    assert np.abs(picture.astype(int) - QUARTERS)[inner].max() <= 1


def test_faces_without_an_image_keep_their_vertices_colours() -> None:
    images, _ = cache_of(QUARTERS)
    texturing = Texturing(UVS, np.array([-1, 0], np.int32), images)
    colours = np.full((4, 3), 77, dtype=np.uint8)
    picture = render_mesh(
        PLATE, FACES, ABOVE, (64, 64),
        colours=colours, texturing=texturing, relief=0.0, shadows=False,
    )  # fmt: skip
    assert picture[10, 50].tolist() == [77, 77, 77]
    assert picture[50, 10].tolist() == [10, 10, 250]


def test_a_tint_marks_faces_from_one_on() -> None:
    colours = np.full((4, 3), 100, dtype=np.uint8)
    picture = render_mesh(
        PLATE, FACES, ABOVE, (64, 64),
        colours=colours, tint=Tint(1, (200.0, 100.0, 0.0), 0.5), relief=0.0, shadows=False,
    )  # fmt: skip
    assert picture[10, 50].tolist() == [100, 100, 100]
    assert picture[50, 10].tolist() == [150, 100, 50]


def test_far_away_a_texture_is_read_smaller() -> None:
    grid = np.indices((512, 512)).sum(axis=0) % 2 * 255
    fine = np.repeat(grid[..., None], 3, axis=2).astype(np.uint8)
    images, _ = cache_of(fine, max_bytes=1 << 22)
    texturing = Texturing(UVS, np.zeros(2, np.int32), images)
    picture = render_mesh(
        PLATE, FACES, ABOVE, (64, 64), texturing=texturing, relief=0.0, shadows=False
    )
    # One pixel covers 8 x 8 texels of black and white: grey, not a sample of them.
    assert np.abs(picture[4:-4, 4:-4].astype(int) - 128).max() <= 2


def test_images_are_kept_within_the_bound_and_read_once() -> None:
    images, read = cache_of(
        *(np.full((64, 64, 3), n, np.uint8) for n in range(4)), max_bytes=30_000
    )
    for number in (0, 1, 0, 1):
        assert images.get(number, 0)[0, 0, 0] == number
    assert read == [0, 1]
    images.get(2, 0)  # 12,288 bytes each: the oldest goes
    images.get(0, 0)
    assert read == [0, 1, 2, 0]
    assert images.size(3) == (64, 64)


def test_bilinear_is_exact_at_texels_and_between_them() -> None:
    image = np.array([[[0] * 3, [100] * 3], [[50] * 3, [150] * 3]], dtype=np.uint8)
    uvs = np.array([[0.25, 0.25], [0.75, 0.25], [0.5, 0.5], [0.0, 1.0], [2.0, -1.0]])
    assert bilinear(image, uvs)[:, 0].tolist() == [0, 100, 75, 50, 100]


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
@pytest.mark.parametrize("halvings", [0, 1, 2, 3])
def test_images_are_halved_while_they_decode(kind: str, halvings: int) -> None:
    pixels = np.zeros((96, 160, 3), dtype=np.uint8)
    pixels[:48] = 200
    decoded = decode_halved(file_of(pixels, kind), halvings)
    assert decoded.shape == (96 >> halvings, 160 >> halvings, 3)
    assert abs(int(decoded[0, 0, 0]) - 200) < 6
    assert decoded[-1, 0, 0] < 6


def test_what_is_no_image_is_an_error_that_says_so() -> None:
    with pytest.raises(EngineError, match="an image of 4 bytes does not decode"):
        decode_halved(b"nope", 0)
