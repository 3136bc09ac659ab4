"""Colours of an atlas: every texel of every chart from photo or vertex colours.

A texel's place in its photo is interpolated between the face's corners, whose pixels were projected
exactly. Within a face of the detail that differs from projecting the texel's own point by less than
a hundredth of a pixel (a face of 20 pixels whose depth changes by 1 %); within a large face of a
base by about a pixel, where a texel is several.

How a texel is coloured is stated in :mod:`terraport_pipeline.geometry.photos.view_choice`.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyInt, Float32, Float64, Int32, UInt8
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input
from terraport_pipeline.geometry.photos.lens_kernels import HEIGHT, WIDTH, project_packed
from terraport_pipeline.geometry.photos.photo_samples import apply_gain, gain_at, sample
from terraport_pipeline.geometry.textures.texel_frame import (
    NO_AREA,
    face_frame,
    middle_texel,
    texel_box,
    texel_weights,
)

__all__ = ["NO_PHOTO", "FaceColours", "bake_photo_faces", "bake_plain_faces"]

NO_PHOTO: Final = as_kernel_input(np.zeros((1, 1, 3)), np.uint8)
"""Stands for the second photo where there is none."""


@dataclass(frozen=True, slots=True, eq=False)
class FaceColours:
    """What colours F faces: :class:`~terraport_pipeline.geometry.photos.view_choice.ViewChoice`."""

    view: Int32
    """(F,)"""
    blend_view: Int32
    """(F,)"""
    blend_weight: Float32
    """(F, 3)"""
    correction: Float32
    """(F, 3, 3) corner, channel."""
    colours: UInt8
    """(F, 3, 3) vertex colours of the corners."""

    def rows(self, which: AnyInt) -> FaceColours:
        """Select faces; (K, ...) of every field."""
        return FaceColours(
            self.view[which],
            self.blend_view[which],
            self.blend_weight[which],
            self.correction[which],
            self.colours[which],
        )


def bake_photo_faces(
    image: UInt8,
    covered: UInt8,
    texels: Float64,
    pixels: Float32,
    which: Int32,
    colours: FaceColours,
    photo: UInt8,
    packed: Float64,
    gain: Float32,
    other: tuple[UInt8, Float64, Float32, Float64] | None = None,
    margin: float = 0.0,
) -> None:
    """Draw faces of one photo, and of one second photo where they blend.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3), uint8
        Written to.
    covered : ndarray of shape (H, W), uint8
        Set to 1 where a face was drawn.
    texels : ndarray of shape (F, 3, 2), float64
        Corners in the image.
    pixels : ndarray of shape (F, 3, 2), float32
        Corners in the photo, pixels of the lens.
    which : ndarray of shape (K,), int32
        Faces to draw.
    colours : FaceColours
        Of all F faces.
    photo : ndarray of shape (H', W', 3), uint8
        Of any size.
    packed : ndarray of shape (PACKED,), float64
        The photo's view.
    gain : ndarray of shape (GAIN_COLUMNS,), float32
        The photo's exposure.
    other : (photo, packed, gain, points), optional
        The second photo, and the corners (F, 3, 3) in metres.
    margin : float
        Texels beyond its edges that each face is drawn on, where nothing is drawn yet: the photo
        goes on there, so a sample on a chart's rim reads what the neighbouring chart shows.
    """
    if other is None:
        none = np.zeros((0, 3, 3))
        _bake_photo(
            image, covered, texels, pixels, which, colours.blend_weight, colours.correction,
            photo, packed, gain, NO_PHOTO, packed, gain, none, margin, blends=False,
        )  # fmt: skip
        return
    second, second_packed, second_gain, points = other
    _bake_photo(
        image, covered, texels, pixels, which, colours.blend_weight, colours.correction,
        photo, packed, gain, second, second_packed, second_gain, points, margin, blends=True,
    )  # fmt: skip


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _bake_photo(
    image: UInt8,
    covered: UInt8,
    texels: Float64,
    pixels: Float32,
    which: Int32,
    blend_weight: Float32,
    correction: Float32,
    photo: UInt8,
    packed: Float64,
    gain: Float32,
    second: UInt8,
    second_packed: Float64,
    second_gain: Float32,
    points: Float64,
    margin: float,
    blends: bool,
) -> None:
    """Draw faces of one photo; see :func:`bake_photo_faces`. `second` is the other photo."""
    scale_x, scale_y = photo.shape[1] / packed[WIDTH], photo.shape[0] / packed[HEIGHT]
    second_x = second.shape[1] / second_packed[WIDTH]
    second_y = second.shape[0] / second_packed[HEIGHT]
    # (1) Corners of the face in the photos' own pixels, which may be finer or coarser than the
    # lens's. Everything that varies over the face is set at its corners and interpolated linearly
    # inside.
    # Per corner: x, y in the photo, vignetting; the same of the second photo; its weight.
    at = np.zeros((3, 7))
    for index in range(len(which)):
        f = which[index]
        mixing = blends
        for c in range(3):
            x, y = np.float64(pixels[f, c, 0]), np.float64(pixels[f, c, 1])
            at[c, 0], at[c, 1] = x * scale_x, y * scale_y
            at[c, 2] = gain_at(gain, packed, x, y)
            if mixing:
                u, v, _ = project_packed(
                    second_packed, points[f, c, 0], points[f, c, 1], points[f, c, 2]
                )
                mixing = np.isfinite(u) and np.isfinite(v)
                at[c, 3], at[c, 4] = u * second_x, v * second_y
                at[c, 5] = gain_at(second_gain, second_packed, u, v)
                at[c, 6] = blend_weight[f, c]
        # (2) Every texel whose middle lies in the face. Invariant: a texel within a face is
        # overwritten, a texel of the margin only where nothing is drawn yet, so margins never
        # hide a face.
        box = texel_box(texels[f], image.shape[1], image.shape[0], margin)
        drawn = False
        sides, least = face_frame(texels[f], margin)
        if abs(sides[4]) > NO_AREA:
            for j in range(box[1], box[3]):
                for i in range(box[0], box[2]):
                    l0, l1, l2 = texel_weights(texels[f], sides, i, j)
                    if l0 < least[0] or l1 < least[1] or l2 < least[2]:
                        continue
                    if margin > 0.0 and covered[j, i]:
                        continue
                    drawn = True
                    _write_photo(
                        image, covered, i, j, l0, l1, l2, at, correction[f],
                        photo, gain, second, second_gain, mixing,
                    )  # fmt: skip
        # (3) A face that no texel's middle lies in still has a colour: in the texel under its
        # middle, if free.
        if (
            not drawn and margin == 0.0
        ):  # smaller than a texel: its middle takes the texel that nobody has
            third = 1.0 / 3.0
            i, j = middle_texel(texels[f], sides)
            if not covered[j, i]:
                _write_photo(
                    image, covered, i, j, third, third, third, at, correction[f],
                    photo, gain, second, second_gain, mixing,
                )  # fmt: skip


@numba.njit(cache=True, nogil=True, inline="always")
def _write_photo(
    image: UInt8,
    covered: UInt8,
    i: int,
    j: int,
    l0: float,
    l1: float,
    l2: float,
    at: Float64,
    correction: Float32,
    photo: UInt8,
    gain: Float32,
    second: UInt8,
    second_gain: Float32,
    mixing: bool,
) -> None:
    """Colour texel (i, j) from photos at barycentric weights l0, l1, l2 of the face's corners.

    Parameters
    ----------
    image, covered : ndarray of shape (H, W, 3), (H, W)
        Written.
    i, j : int
        Column and row of the texel.
    l0, l1, l2 : float
        Weights; they sum to 1.
    at : ndarray of shape (3, 7), float64
        Per corner: x, y in the photo and vignetting; the same of the second photo; its weight.
    correction : ndarray of shape (3, 3), float32
        Levels to add, by corner and channel.
    photo, gain, second, second_gain : ndarray
        The two photos, and their gains by channel.
    mixing : bool
        Whether the second photo counts.
    """
    # (1) Corner values, weighted by the texel's barycentric coordinates.
    x = l0 * at[0, 0] + l1 * at[1, 0] + l2 * at[2, 0]
    y = l0 * at[0, 1] + l1 * at[1, 1] + l2 * at[2, 1]
    h = l0 * at[0, 2] + l1 * at[1, 2] + l2 * at[2, 2]
    weight = x2 = y2 = h2 = 0.0
    if mixing:
        weight = min(l0 * at[0, 6] + l1 * at[1, 6] + l2 * at[2, 6], 1.0)
        x2 = l0 * at[0, 3] + l1 * at[1, 3] + l2 * at[2, 3]
        y2 = l0 * at[0, 4] + l1 * at[1, 4] + l2 * at[2, 4]
        h2 = l0 * at[0, 5] + l1 * at[1, 5] + l2 * at[2, 5]
    # (2) Exposure first, then the blend, then the correction, which is in levels of the exposed
    # picture. The weight of the second photo is 0 where the face does not blend.
    for k in range(3):
        level = apply_gain(sample(photo, x, y, k), h * gain[k])
        if weight > 0.0:
            there = apply_gain(sample(second, x2, y2, k), h2 * second_gain[k])
            level += weight * (there - level)
        level += l0 * correction[0, k] + l1 * correction[1, k] + l2 * correction[2, k]
        image[j, i, k] = np.uint8(min(max(level + 0.5, 0.0), 255.0))
    covered[j, i] = 1


def bake_plain_faces(
    image: UInt8,
    covered: UInt8,
    texels: Float64,
    which: Int32,
    colours: FaceColours,
    gain: Float32,
    margin: float = 0.0,
) -> None:
    """Draw faces by their vertex colours.

    Parameters
    ----------
    image, covered, texels, which, colours
        As in :func:`bake_photo_faces`.
    gain : ndarray of shape (GAIN_COLUMNS,), float32
        That of the vertex colours.
    margin : float
        As there.
    """
    _bake_plain(image, covered, texels, which, colours.colours, colours.correction, gain, margin)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _bake_plain(
    image: UInt8,
    covered: UInt8,
    texels: Float64,
    which: Int32,
    colours: UInt8,
    correction: Float32,
    gain: Float32,
    margin: float,
) -> None:
    level = np.zeros((3, 3))
    for index in range(len(which)):
        f = which[index]
        # (1) Levels at the corners, with exposure and correction; inside they are interpolated.
        for c in range(3):
            for k in range(3):
                level[c, k] = apply_gain(np.float64(colours[f, c, k]), gain[k])
                level[c, k] += correction[f, c, k]
        # (2) Every texel whose middle lies in the face; of the margin only those that nobody has.
        box = texel_box(texels[f], image.shape[1], image.shape[0], margin)
        drawn = False
        sides, least = face_frame(texels[f], margin)
        if abs(sides[4]) > NO_AREA:
            for j in range(box[1], box[3]):
                for i in range(box[0], box[2]):
                    l0, l1, l2 = texel_weights(texels[f], sides, i, j)
                    if l0 < least[0] or l1 < least[1] or l2 < least[2]:
                        continue
                    if margin > 0.0 and covered[j, i]:
                        continue
                    drawn = True
                    _write_plain(image, covered, i, j, l0, l1, l2, level)
        # (3) Smaller than a texel: its middle takes the texel that nobody has.
        if not drawn and margin == 0.0:
            third = 1.0 / 3.0
            i, j = middle_texel(texels[f], sides)
            if not covered[j, i]:
                _write_plain(image, covered, i, j, third, third, third, level)


@numba.njit(cache=True, nogil=True, inline="always")
def _write_plain(
    image: UInt8,
    covered: UInt8,
    i: int,
    j: int,
    l0: float,
    l1: float,
    l2: float,
    level: Float64,
) -> None:
    for k in range(3):
        value = l0 * level[0, k] + l1 * level[1, k] + l2 * level[2, k]
        image[j, i, k] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
    covered[j, i] = 1
