"""Which points lie in which photos, and how finely the photos show them. Occlusion is left out.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np

from terraport_payload.types import AnyFloat, Float64, Int32
from terraport_pipeline.geometry.photos import lens_kernels as kernels
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.geometry.photos.lens_kernels import project_packed

__all__ = ["cover_points"]


def cover_points(
    views: Sequence[View], points: AnyFloat, *, coarsest_m: float = np.inf
) -> tuple[Int32, Float64, Int32]:
    """Count the photos that each point falls into.

    Parameters
    ----------
    views : sequence of View
    points : ndarray of shape (N, 3)
        Metres, scene frame.
    coarsest_m : float
        A photo whose pixel is wider than this at a point does not count there.

    Returns
    -------
    photos : ndarray of shape (N,), int32
        Photos whose picture the point falls into.
    finest_m : ndarray of shape (N,), float64
        Width of a pixel at the point (depth over focal length) in the best of them; infinite
        where there is none.
    points_in_view : ndarray of shape (len(views),), int32
        Points that fall into each photo.
    """
    rows = np.ascontiguousarray(points, dtype=np.float64)
    photos = np.zeros(len(rows), dtype=np.int32)
    finest_m = np.full(len(rows), np.inf)
    points_in_view = np.zeros(len(views), dtype=np.int32)
    for index, view in enumerate(views):
        points_in_view[index] = _add_view(view.packed(), rows, coarsest_m, photos, finest_m)
    return photos, finest_m, points_in_view


@numba.njit(cache=True, nogil=True)
def _add_view(
    packed: Float64, points: Float64, coarsest_m: float, photos: Int32, finest_m: Float64
) -> int:
    focal = np.sqrt(packed[kernels.FX] * packed[kernels.FY])
    width, height = packed[kernels.WIDTH], packed[kernels.HEIGHT]
    count = 0
    for i in range(len(points)):
        u, v, depth = project_packed(packed, points[i, 0], points[i, 1], points[i, 2])
        pixel_m = depth / focal
        if 0.0 <= u < width and 0.0 <= v < height and pixel_m <= coarsest_m:
            photos[i] += 1
            finest_m[i] = min(finest_m[i], pixel_m)
            count += 1
    return count
