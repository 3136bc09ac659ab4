"""Colours and sharpness read from photos.

Photos are (H', W', 3) uint8 arrays, sRGB, of any size: pixels of a view's lens (whose picture is W
x H) are scaled to it. Both count from the top left corner of the top left pixel.

**Gains.** Exposure is a factor in linear light. On sRGB levels 11..255, where level + 14.025 is
proportional to light^(1 / 2.4) (IEC 61966-2-1), the same factor is an affine map::

    level' = (level + 14.025) h - 14.025,   h = factor^(1 / 2.4)

exact there and close below; no table and no power per pixel. :func:`gain_at` gives h with the
photo's vignetting, :func:`apply_gain` the level.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, UInt8
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.photos.lens_kernels import HEIGHT, WIDTH

__all__ = [
    "GAIN_COLUMNS",
    "SRGB_OFFSET",
    "apply_gain",
    "gain_at",
    "neutral_gains",
    "sample",
    "sample_faces",
    "sharpness_map",
]

SRGB_OFFSET: Final = 0.055 * 255.0
"""Level at which the power part of sRGB's curve would reach no light, below zero."""

GAIN_COLUMNS: Final = 5
"""Numbers of one photo's gain: h of red, green and blue at the picture's middle, and the two
coefficients of vignetting a, b: h(rho) = h (1 + a rho^2 + b rho^4), rho = 1 in the corners."""

_SHARPNESS_CELLS: Final = 96
"""Cells of the sharpness map along the photo's longer side: about 40 pixels of a 12 M-pixel
photo."""


def neutral_gains(n_views: int) -> Float32:
    """Gains that change nothing, (n_views + 1, GAIN_COLUMNS) float32."""
    gains = np.zeros((n_views + 1, GAIN_COLUMNS), np.float32)
    gains[:, :3] = 1.0
    return gains


@numba.njit(cache=True, nogil=True, inline="always")
def gain_at(gain: Float32, packed: Float64, u: float, v: float) -> float:
    """Vignetting's part of h at a pixel of the lens; multiply by ``gain[channel]``."""
    width, height = packed[WIDTH], packed[HEIGHT]
    x, y = u - 0.5 * width, v - 0.5 * height
    square = 4.0 * (x * x + y * y) / (width * width + height * height)
    h: float = 1.0 + square * (gain[3] + square * gain[4])
    return h


@numba.njit(cache=True, nogil=True, inline="always")
def apply_gain(level: float, h: float) -> float:
    """Level 0..255 (sRGB) after a gain; may leave 0..255."""
    return (level + SRGB_OFFSET) * h - SRGB_OFFSET


@numba.njit(cache=True, nogil=True, inline="always")
def sample(photo: UInt8, x: float, y: float, k: int) -> float:
    """Level of channel k at a place of the array, bilinear; beyond the border its last pixel."""
    rows, columns = photo.shape[0], photo.shape[1]
    x = min(max(x - 0.5, 0.0), columns - 1.0)
    y = min(max(y - 0.5, 0.0), rows - 1.0)
    i, j = min(int(x), columns - 2), min(int(y), rows - 2)
    i, j = max(i, 0), max(j, 0)
    i1, j1 = min(i + 1, columns - 1), min(j + 1, rows - 1)
    s, t = x - i, y - j
    level: float = (1.0 - t) * ((1.0 - s) * photo[j, i, k] + s * photo[j, i1, k]) + t * (
        (1.0 - s) * photo[j1, i, k] + s * photo[j1, i1, k]
    )
    return level


def sample_faces(
    photo: UInt8,
    packed: Float64,
    gain: Float32,
    faces: Int32,
    uv: Float32,
    which: Int32,
    *,
    threads: int = 1,
) -> UInt8:
    """Mean colour of faces in a photo, after its gain.

    Parameters
    ----------
    photo : ndarray of shape (H', W', 3), uint8
        Best of a size at which a face covers about one pixel.
    packed : ndarray of shape (PACKED,), float64
    gain : ndarray of shape (GAIN_COLUMNS,), float32
    faces : ndarray of shape (F, 3), int32
    uv : ndarray of shape (V, 2), float32
        Pixels of the vertices.
    which : ndarray of shape (C,), int32
        Faces asked for; inside the picture.
    threads : int

    Returns
    -------
    ndarray of shape (C, 3), uint8
        Mean over the centre and three places half way to the corners.
    """
    colours = np.empty((len(which), 3), np.uint8)
    in_chunks(
        lambda begin, end: _sample_faces(
            photo, packed, gain, faces, uv, which, colours, begin, end
        ),
        len(which), threads=threads,
    )  # fmt: skip
    return colours


def sharpness_map(photo: UInt8) -> Float32:
    """Say how sharp a photo is, place by place.

    Parameters
    ----------
    photo : ndarray of shape (H', W', 3), uint8

    Returns
    -------
    ndarray of shape (rows, columns), float32
        Mean gradient magnitude of the green channel in cells, levels per pixel, averaged with the
        neighbouring cells. Compare between photos of one place, not between places: a field has
        less to be sharp about than a scree.
    """
    step = max(1, -(-max(photo.shape[:2]) // _SHARPNESS_CELLS))
    return _block_gradients(photo, step)


@numba.njit(cache=True, nogil=True)
def _block_gradients(photo: UInt8, step: int) -> Float32:
    rows, columns = -(-photo.shape[0] // step), -(-photo.shape[1] // step)
    total = np.zeros((rows, columns), np.float64)
    count = np.zeros((rows, columns), np.float64)
    # (1) Gradient of the green channel, summed by block.
    for y in range(photo.shape[0] - 1):
        for x in range(photo.shape[1] - 1):
            here = np.int32(photo[y, x, 1])
            dx = np.int32(photo[y, x + 1, 1]) - here
            dy = np.int32(photo[y + 1, x, 1]) - here
            total[y // step, x // step] += np.sqrt(np.float64(dx * dx + dy * dy))
            count[y // step, x // step] += 1.0
    # (2) Mean over the nine blocks around, so that one sharp edge does not make a block sharp.
    result = np.empty((rows, columns), np.float32)
    for r in range(rows):
        for c in range(columns):
            total_step, n = 0.0, 0.0
            for i in range(max(r - 1, 0), min(r + 2, rows)):
                for j in range(max(c - 1, 0), min(c + 2, columns)):
                    total_step += total[i, j]
                    n += count[i, j]
            result[r, c] = total_step / n if n > 0.0 else 0.0
    return result


@numba.njit(cache=True, nogil=True)
def _sample_faces(
    photo: UInt8,
    packed: Float64,
    gain: Float32,
    faces: Int32,
    uv: Float32,
    which: Int32,
    colours: UInt8,
    begin: int,
    end: int,
) -> None:
    """Sample one photo on faces ``which[begin:end]``, into `colours`.

    Parameters
    ----------
    photo : ndarray of shape (H, W, 3), uint8
    packed, gain : ndarray of shape (PACKED,), (GAIN_COLUMNS,)
        The view and its exposure.
    faces, uv : ndarray of shape (F, 3), (V, 2)
        The mesh, and the pixels of its vertices.
    which : ndarray of shape (C,), int32
        Faces to sample.
    colours : ndarray of shape (C, 3), uint8
        Written.
    begin, end : int
        Rows of `which`.
    """
    scale_x, scale_y = photo.shape[1] / packed[WIDTH], photo.shape[0] / packed[HEIGHT]
    for c in range(begin, end):
        # (1) The face's middle, in pixels of the lens.
        f = which[c]
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        u = (np.float64(uv[i, 0]) + uv[j, 0] + uv[k, 0]) / 3.0
        v = (np.float64(uv[i, 1]) + uv[j, 1] + uv[k, 1]) / 3.0
        h = gain_at(gain, packed, u, v)
        # (2) Mean of four samples, at the middle and halfway to each corner; then the exposure.
        for channel in range(3):
            level = sample(photo, u * scale_x, v * scale_y, channel)
            for corner in range(3):
                w = faces[f, corner]
                level += sample(
                    photo, 0.5 * (u + uv[w, 0]) * scale_x, 0.5 * (v + uv[w, 1]) * scale_y, channel
                )
            level = apply_gain(0.25 * level, h * gain[channel])
            colours[c, channel] = np.uint8(min(max(level + 0.5, 0.0), 255.0))
