"""Whether something stands between a face and a camera.

The truth is a ray from the face to the camera. Casting one per face and photo is what takes longest
in the choice of views (10 M faces in 8 photos each: 80 M rays, 45 s of one core), and most faces
lie in the open. So each photo first gets a coarse *depth grid*, one ray per few faces, cast from
the camera: a face is clear where the four grid rays around it end on or behind its own plane,
within the roughness that a grid cell may hide. Every other face gets its exact rays: from its
centre, and from its corners too where it is large.

PURE: no I/O, no clock; the rays are cast by whatever the caller gives.
"""

from __future__ import annotations

from typing import Final, Protocol

import numba
import numpy as np
import numpy.typing as npt

from terraport_payload.types import Bool, Float32, Float64, Int32
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.mesh_blocks import MeshBlocks
from terraport_pipeline.geometry.photos.lens import View, ray_packed
from terraport_pipeline.geometry.photos.lens_kernels import (
    FX,
    HEIGHT,
    POSITION,
    WIDTH,
    project_packed,
)
from terraport_pipeline.geometry.photos.view_candidates import Rated

__all__ = ["Occluder", "visible_faces"]


_FACES_PER_RAY: Final = 4
"""Faces per ray of the depth grid. A rod thinner than the grid's spacing, two faces' width, can
slip through; so it would between the faces' own rays."""

_FEW_FACES: Final = 4096
"""Up to so many faces get their exact rays at once: the grid would not save anything."""

_LARGE_PX: Final = 64.0
"""Faces of more square pixels than this are also tested at their corners."""

_CORNER: Final = 0.9
"""Corners are tested this far out from the centre, so that a neighbour across a crease that touches
the corner does not count."""

_ROUGHNESS_CELLS: Final = 0.35
"""How far in front of a face's plane a grid ray may end, in widths of a grid cell on the ground:
what lies lower than this cannot hide more than a third of a cell."""

_OFFSET_EDGES: Final = 0.25
"""Rays begin this many face widths above the face, so that noise of neighbouring faces does not
hide it."""

_OFFSET_DISTANCE: Final = 2e-5
"""And this part of the distance to the camera, for float32."""

_CHUNK_FACES: Final = 2**19
"""Faces whose rays are made at once: 24 bytes a ray, 4 rays at most."""


class Occluder(Protocol):
    """What can hide faces: :class:`terraport_pipeline.engines.rays.RayScene` is one."""

    def closest_hit(
        self, origins: npt.ArrayLike, directions: npt.ArrayLike
    ) -> tuple[Float32, Int32]:
        """Distances in units of the directions' lengths (inf: nothing hit), and faces hit."""
        ...


def visible_faces(
    blocks: MeshBlocks,
    view: View,
    rated: Rated,
    occluder: Occluder,
    *,
    offset_m: float = 0.0,
    threads: int = 1,
) -> tuple[Bool, int]:
    """Find which faces nothing hides from a photo.

    Parameters
    ----------
    blocks : MeshBlocks
        The mesh whose faces are asked for.
    view : View
    rated : Rated
        C faces inside the picture.
    occluder : Occluder
        Usually holds the mesh itself too.
    offset_m : float
        Occluders nearer to a face than this are overlooked, metres along its normal: where the
        occluder is another, coarser surface, how far that one may lie from the mesh.
    threads : int

    Returns
    -------
    visible : ndarray of shape (C,), bool
    rays : int
        Rays cast.
    """
    n_faces, cast = len(rated.face), 0
    packed = view.packed()
    unsure = np.ones(n_faces, np.bool_)
    if n_faces > _FEW_FACES:
        depth, rays = _depth_grid(view, packed, n_faces, occluder, threads)
        cast = depth.size

        def clear(begin: int, end: int) -> None:
            _find_unsure(
                packed, blocks.vertices, blocks.faces, rated.face, rated.area, depth, rays,
                offset_m, unsure, begin, end,
            )  # fmt: skip

        in_chunks(clear, n_faces, threads=threads)
    visible = ~unsure
    ask = np.flatnonzero(unsure).astype(np.int32)
    for first in range(0, len(ask), _CHUNK_FACES):
        rows = ask[first : first + _CHUNK_FACES]
        origins, owner = _face_rays(
            packed, blocks.vertices, blocks.faces, rated.face, rated.area, offset_m, rows
        )
        distance, _ = occluder.closest_hit(origins, view.position.astype(np.float32) - origins)
        visible[rows] = True
        visible[owner[distance < 1.0]] = False
        cast += len(origins)
    return visible, cast


def _depth_grid(
    view: View, packed: Float64, n_faces: int, occluder: Occluder, threads: int
) -> tuple[Float32, Float32]:
    """Distance along the ray of every grid corner, metres, and the rays; they span the picture."""
    width, height = view.lens.width, view.lens.height
    step = max(2.0, float(np.sqrt(width * height * _FACES_PER_RAY / n_faces)))
    columns = max(2, int(np.ceil(width / step)) + 1)
    rows = max(2, int(np.ceil(height / step)) + 1)
    rays = np.empty((rows * columns, 3), np.float32)
    in_chunks(
        lambda begin, end: _grid_rays(packed, rows, columns, rays, begin, end),
        rows * columns, threads=threads, chunk=2**15,
    )  # fmt: skip
    origins = np.broadcast_to(view.position.astype(np.float32), rays.shape)
    distance, _ = occluder.closest_hit(origins, rays)
    return distance.reshape(rows, columns), rays.reshape(rows, columns, 3)


@numba.njit(cache=True, nogil=True)
def _grid_rays(
    packed: Float64, rows: int, columns: int, rays: Float32, begin: int, end: int
) -> None:
    for i in range(begin, end):
        u = packed[WIDTH] * (i % columns) / (columns - 1)
        v = packed[HEIGHT] * (i // columns) / (rows - 1)
        x, y, z = ray_packed(packed, u, v)
        rays[i, 0], rays[i, 1], rays[i, 2] = x, y, z


@numba.njit(cache=True, nogil=True)
def _face_frame(
    vertices: Float32, faces: Int32, f: int
) -> tuple[float, float, float, float, float, float, float]:
    """Centre, unit normal and width (root of twice the area) of a face."""
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    ix, iy, iz = np.float64(vertices[i, 0]), np.float64(vertices[i, 1]), np.float64(vertices[i, 2])
    jx, jy, jz = np.float64(vertices[j, 0]), np.float64(vertices[j, 1]), np.float64(vertices[j, 2])
    kx, ky, kz = np.float64(vertices[k, 0]), np.float64(vertices[k, 1]), np.float64(vertices[k, 2])
    nx = (jy - iy) * (kz - iz) - (jz - iz) * (ky - iy)
    ny = (jz - iz) * (kx - ix) - (jx - ix) * (kz - iz)
    nz = (jx - ix) * (ky - iy) - (jy - iy) * (kx - ix)
    size = np.sqrt(nx * nx + ny * ny + nz * nz)
    scale = 1.0 / size if size > 0.0 else 0.0
    return (
        (ix + jx + kx) / 3.0, (iy + jy + ky) / 3.0, (iz + jz + kz) / 3.0,
        nx * scale, ny * scale, nz * scale, np.sqrt(size),
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _find_unsure(
    packed: Float64,
    vertices: Float32,
    faces: Int32,
    face: Int32,
    area: Float32,
    depth: Float32,
    rays: Float32,
    offset_m: float,
    unsure: Bool,
    begin: int,
    end: int,
) -> None:
    """Mark the faces that the depth grid does not show to be clear.

    Parameters
    ----------
    packed : ndarray of shape (PACKED,), float64
        The view.
    vertices, faces : ndarray
        The mesh, metres.
    face, area : ndarray of shape (C,)
        Columns of :class:`~.view_candidates.Rated`.
    depth, rays : ndarray of shape (rows, columns), (rows, columns, 3)
        Distance at which the rays of a coarse grid over the picture end, and their directions.
    offset_m : float
        Height above the surface that hides nothing.
    unsure : ndarray of shape (C,), bool
        Written: cleared where the face is seen for certain.
    begin, end : int
        Rows of the columns.
    """
    # (1) Width of a grid cell in pixels; where the camera stands.
    rows, columns = depth.shape
    step_u, step_v = packed[WIDTH] / (columns - 1), packed[HEIGHT] / (rows - 1)
    step = max(step_u, step_v)
    px, py, pz = packed[POSITION], packed[POSITION + 1], packed[POSITION + 2]
    for c in range(begin, end):
        if area[c] > step * step:
            continue  # larger than a cell: the grid says too little
        # (2) The face's centre, and the grid cell that it is seen in.
        x, y, z, nx, ny, nz, _ = _face_frame(vertices, faces, face[c])
        u, v, along = project_packed(packed, x, y, z)
        column, row = int(u / step_u), int(v / step_v)
        if not (0 <= column < columns - 1 and 0 <= row < rows - 1):
            continue
        tx, ty, tz = x - px, y - py, z - pz
        # (3) Clear only if all four grid rays around it ended at or below the face's plane,
        # within what a rough surface does inside one cell. Invariant: a face is cleared on proof
        # alone; whatever fails (NaN too) leaves it for a ray of its own.
        slack = _ROUGHNESS_CELLS * step * along / packed[FX] + offset_m
        plane = nx * tx + ny * ty + nz * tz  # negative: the face looks at the camera
        clear = True
        for corner in range(4):
            r, q = row + corner // 2, column + corner % 2
            hit = depth[r, q]
            if not hit >= 0.0:
                clear = False
                break
            facing = nx * rays[r, q, 0] + ny * rays[r, q, 1] + nz * rays[r, q, 2]
            if not facing < -0.05:
                clear = False
                break
            # height above the face's plane at which the grid ray ended
            height = hit * facing - plane
            if not height <= slack:
                clear = False
                break
        if clear:
            unsure[c] = False


@numba.njit(cache=True, nogil=True)
def _face_rays(
    packed: Float64,
    vertices: Float32,
    faces: Int32,
    face: Int32,
    area: Float32,
    offset_m: float,
    ask: Int32,
) -> tuple[Float32, Int32]:
    """Where the exact rays of some faces begin, and which face each belongs to."""
    px, py, pz = packed[POSITION], packed[POSITION + 1], packed[POSITION + 2]
    # (1) One ray for a small face, four for a large one, which may be hidden in part.
    count = 0
    for c in ask:
        count += 4 if area[c] > _LARGE_PX else 1
    origins = np.empty((count, 3), np.float32)
    owner = np.empty(count, np.int32)
    n = 0
    for c in ask:
        # (2) From just above the face, by its own size, the distance (float32) and the surface's
        # noise.
        f = face[c]
        x, y, z, nx, ny, nz, width = _face_frame(vertices, faces, f)
        distance = np.sqrt((x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2)
        lift = _OFFSET_EDGES * width + _OFFSET_DISTANCE * distance + offset_m
        for corner in range(4 if area[c] > _LARGE_PX else 1):
            ox, oy, oz = x, y, z
            if corner > 0:
                i = faces[f, corner - 1]
                ox += _CORNER * (vertices[i, 0] - x)
                oy += _CORNER * (vertices[i, 1] - y)
                oz += _CORNER * (vertices[i, 2] - z)
            origins[n, 0], origins[n, 1], origins[n, 2] = (
                ox + lift * nx, oy + lift * ny, oz + lift * nz,
            )  # fmt: skip
            owner[n] = c
            n += 1
    return origins, owner
