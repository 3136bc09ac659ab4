"""Where on the surface the texels of an atlas lie, for colours that are looked up by place.

Two steps, so that no list has to grow: every texel gets the face that it shows, then the place of
its centre in that face's plane.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, UInt8
from terraport_pipeline.geometry.textures.texel_frame import (
    NO_AREA,
    face_frame,
    middle_texel,
    texel_box,
    texel_weights,
)

__all__ = ["texel_places"]


def texel_places(
    covered: UInt8, texels: Float64, points: Float64, which: Int32, margin: float = 0.0
) -> tuple[Int32, Float32]:
    """Find the texels that faces cover, and the place of each.

    Parameters
    ----------
    covered : ndarray of shape (H, W), uint8
        Set to 1 for the texels that are returned.
    texels : ndarray of shape (F, 3, 2), float64
        Corners in the image.
    points : ndarray of shape (F, 3, 3), float64
        Corners on the surface, metres.
    which : ndarray of shape (K,), int32
        Faces; of two that cover a texel the later one has it.
    margin : float
        Texels beyond its edges that each face covers, where nothing is yet.

    Returns
    -------
    texel : ndarray of shape (N, 2), int32
        Row and column, by rows.
    place : ndarray of shape (N, 3), float32
        Metres. Of a face smaller than a texel some place on it.

    Examples
    --------
    >>> corners = np.array([[[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]]])
    >>> surface = np.array([[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, 4.0]]])
    >>> covered = np.zeros((2, 2), np.uint8)
    >>> texel, place = texel_places(covered, corners, surface, np.array([0], np.int32))
    >>> texel.tolist()
    [[0, 0], [0, 1], [1, 0]]
    >>> place.tolist()
    [[1.0, 0.0, 1.0], [3.0, 0.0, 1.0], [1.0, 0.0, 3.0]]
    """
    owner = np.full(covered.shape, -1, np.int32)
    _claim(owner, covered, texels, which, margin)
    texel = np.argwhere(owner >= 0).astype(np.int32)
    place = np.empty((len(texel), 3), np.float32)
    _places(texel, owner, texels, points, place)
    return texel, place


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _claim(owner: Int32, covered: UInt8, texels: Float64, which: Int32, margin: float) -> None:
    """Write into `owner` the face that each texel shows; the rules of bake.py."""
    for index in range(len(which)):
        f = which[index]
        box = texel_box(texels[f], owner.shape[1], owner.shape[0], margin)
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
                    owner[j, i] = f
                    covered[j, i] = 1
        if not drawn and margin == 0.0:
            i, j = middle_texel(texels[f], sides)
            if not covered[j, i]:
                owner[j, i] = f
                covered[j, i] = 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _places(texel: Int32, owner: Int32, texels: Float64, points: Float64, place: Float32) -> None:
    third = 1.0 / 3.0
    for index in range(len(texel)):
        j, i = texel[index, 0], texel[index, 1]
        f = owner[j, i]
        sides, _ = face_frame(texels[f], 0.0)
        l0 = l1 = l2 = third
        if abs(sides[4]) > NO_AREA:
            l0, l1, l2 = texel_weights(texels[f], sides, i, j)
            # Beyond a sliver, whose plane leads anywhere, and of a face that no centre lies in.
            if not (-1.0 <= l0 <= 2.0 and -1.0 <= l1 <= 2.0 and -1.0 <= l2 <= 2.0):
                l0 = min(max(l0, 0.0), 1.0)
                l1 = min(max(l1, 0.0), 1.0 - l0)
                l2 = 1.0 - l0 - l1
        for k in range(3):
            place[index, k] = l0 * points[f, 0, k] + l1 * points[f, 1, k] + l2 * points[f, 2, k]
