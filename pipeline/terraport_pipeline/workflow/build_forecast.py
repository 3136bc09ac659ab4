"""What a build will make and take: faces, time, memory, disk.

Faces follow from geometry. A surface cut by a lattice meets ``|nx| + |ny| + |nz|`` edges of it per
area of a cell's side (n its normal): each meeting is a vertex, and a triangle mesh has two faces a
vertex. As many voxels are passed by it, so occupied voxels tell the same without normals, and also
where there are none (brush, rubble); but noise occupies voxels, too. The more of it there is, the
more it is gone by normals and area.

The rest is linear in points and faces, with coefficients fitted to measured builds of real
surveys by ``benchmarks/forecast.py``; how far off they are:
``docs/benchmarks.md``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from terraport_pipeline.geometry.tiles.tile_plan import TilePlan
from terraport_pipeline.options.regions import Options
from terraport_pipeline.workflow.tile_memory import (
    CLEAN_BYTES_PER_POINT,
    PROCESS_BYTES,
    cell_bytes,
    count_cells,
    forecast_tiles,
)

__all__ = [
    "BuildForecast",
    "PhotoSet",
    "SolvedGround",
    "forecast_build",
    "time_terms",
    "with_photos",
]

VOXEL_CELLS: Final = 4.0
"""Side of the voxels that are counted: with samples 1.2 cells apart, what the surface passes has
some in it but at its corners."""

_FACES_PER_VERTEX: Final = 2.0

_VOXEL_FACTOR: Final = 1.06
_NORMAL_FACTOR: Final = 1.03
"""Faces that were made over those that voxels, and normals with area, say."""

_NOISE_THICKNESS: Final = 2.4
"""Voxels are occupied as by a slab of so many deviations of the noise..."""

_MOST_SLAB: Final = 0.5
"""...and they are not counted on any more where it adds so much to them."""

SECONDS: Final = (30.0, 38.0, 18e-6, 18e-6, 1e-7)
"""Of the command with its report, for each of :func:`time_terms`, on the reference machine: two
cores of an AMD EPYC under KVM that nothing else uses. The last was measured by itself (1.4e-7 to
1.9e-7 CPU seconds a pair, on two cores)."""

_REFERENCE_CORES: Final = 2
_PARALLEL_SHARE: Final = 0.4
"""Share of these seconds in which both cores were busy: more cores shorten it, one doubles it."""

_BESIDE_TILES_BYTES: Final = 350 * 2**20
"""Peak of a build above its tiles: the command, and what it holds while they are solved."""

_THINNED_POINTS: Final = 1_500_000
"""The thinned copy is cleaned before any tile: it is the peak of small tiles."""

_REPORT_BYTES: Final = 1_100_000
_BYTES_PER_BASE_FACE: Final = 9.0
_BYTES_PER_FACE: Final = 5.8
_BYTES_PER_ATTRIBUTE: Final = 0.2
"""Of a scene: its report with the pictures, base and image, payloads, and of these per face and
attribute."""

_WORK_BYTES: Final = 5_000_000
_WORK_BYTES_PER_BASE_FACE: Final = 100
_WORK_BYTES_PER_THINNED: Final = 35
_WORK_BYTES_PER_FACE: Final = 130
_WORK_BYTES_PER_FACE_OF_SEVERAL: Final = 170
_WORK_BYTES_PER_ATTRIBUTE: Final = 4
"""Of a work directory, beside the samples as read and as handed out to tiles: records, per face of
the base, per point of the thinned copy, per face of a single tile and of several (with their
margins, and the base's part of each), and per face and attribute."""

_PHOTO_SECONDS: Final = (8e-6, 0.18)
"""Of textures from photos, per face and per megapixel of all photos, on the reference machine."""

_BYTES_PER_TEXEL: Final = 0.33
"""Of an image, for each texel of the surface's area: 0.23 (soft, dark ground) and 0.43 (grass) were
measured."""

_BASE_IMAGE_BYTES: Final = 600_000
_COLOUR_BYTES_PER_FACE: Final = 0.8
"""Of vertex colours, which textured segments do not have."""

_MOST_BASE_FACES: Final = 200_000
_BASE_SHARE: Final = 0.125


@dataclass(frozen=True, slots=True, eq=False)
class SolvedGround:
    """What a build would solve, as far as it is known before."""

    points: int
    surface_m2: float
    """Area of the surface."""
    cell_m: float
    slant: float
    """Mean of |nx| + |ny| + |nz| over the surface: 1 where level, 1.5 for all directions alike."""
    voxels: int | None
    """Occupied by samples; None where not all of the survey was read."""
    voxel_m: float
    noise_m: float
    smoothing_spacings: float
    """Radius of smoothing; 0 where samples are solved as they are."""
    plan: TilePlan
    row_bytes: int
    """Of a sample on disk: coordinates, colour, attributes."""
    attributes: int
    """Attributes of a sample."""


@dataclass(frozen=True, slots=True)
class PhotoSet:
    """What of a survey's photos decides how long their textures take, and how large they are."""

    megapixels: float
    """Of all photos together."""
    pixel_m: float
    """Ground sampling distance: texels are as wide, if nothing else is asked for."""
    surface_m2: float
    """Area of the surface that is textured."""


@dataclass(frozen=True, slots=True)
class BuildForecast:
    """What a build with the default options is expected to make and take."""

    faces: int
    """Of the detail."""
    base_faces: int
    cell_m: float
    tiles: int
    tile_depth: int
    workers: int
    """Tiles at a time."""
    seconds: float
    """With its report, on the cores of this machine were they those of the reference."""
    memory_bytes: int
    """Peak memory of all processes. If regions need more than allowed, the build is refused."""
    scene_bytes: int
    work_bytes: int
    """Work directory beside the scene; it may be deleted."""


def forecast_build(ground: SolvedGround, *, max_memory_bytes: int, threads: int) -> BuildForecast:
    """Forecast a build.

    Parameters
    ----------
    ground : SolvedGround
    max_memory_bytes : int
        That it may take.
    threads : int
        Cores.
    """
    # (1) Faces, and the tiles as the build counts on them.
    faces = _faces(ground)
    base_faces = min(_MOST_BASE_FACES, _BASE_SHARE * faces)
    tiles = forecast_tiles(ground.plan, ground.points, ground.surface_m2, max_memory_bytes, threads)
    # (2) Time: what both cores of the reference shared is shared by all of these.
    seconds = sum(c * term for c, term in zip(SECONDS, time_terms(ground), strict=True))
    shared = _PARALLEL_SHARE * _REFERENCE_CORES / max(1, threads)
    # (3) Memory and disk.
    thinned = min(ground.points, _THINNED_POINTS)
    cleaning = PROCESS_BYTES + CLEAN_BYTES_PER_POINT * thinned
    solving = _BESIDE_TILES_BYTES + tiles.workers * tiles.tile_bytes
    uniting = cell_bytes(count_cells(Options(), ground.surface_m2, faces))
    handed_out = ground.row_bytes * (ground.points + int(ground.plan.points.sum()))
    per_face = _BYTES_PER_FACE + _BYTES_PER_ATTRIBUTE * ground.attributes
    several = ground.plan.count > 1
    work_per_face = _WORK_BYTES_PER_FACE_OF_SEVERAL if several else _WORK_BYTES_PER_FACE
    work_per_face += _WORK_BYTES_PER_ATTRIBUTE * ground.attributes
    return BuildForecast(
        faces=round(faces),
        base_faces=round(base_faces),
        cell_m=ground.cell_m,
        tiles=ground.plan.count,
        tile_depth=ground.plan.shape.depth,
        workers=tiles.workers,
        seconds=round(seconds * (1.0 - _PARALLEL_SHARE + shared), 1),
        memory_bytes=max(uniting, min(max_memory_bytes, max(cleaning, solving))),
        scene_bytes=round(_REPORT_BYTES + _BYTES_PER_BASE_FACE * base_faces + per_face * faces),
        work_bytes=round(
            _WORK_BYTES + handed_out + _WORK_BYTES_PER_THINNED * thinned + work_per_face * faces
        ),
    )


def with_photos(forecast: BuildForecast, photos: PhotoSet, *, threads: int) -> BuildForecast:
    """Forecast the same build with textures from photos.

    Memory stays: textures are drawn tile by tile, and photos are held within a bound.
    """
    per_face, per_megapixel = _PHOTO_SECONDS
    seconds = per_face * forecast.faces + per_megapixel * photos.megapixels
    shared = _PARALLEL_SHARE * _REFERENCE_CORES / max(1, threads)
    image_bytes = _BASE_IMAGE_BYTES + _BYTES_PER_TEXEL * photos.surface_m2 / photos.pixel_m**2
    return replace(
        forecast,
        seconds=round(forecast.seconds + seconds * (1.0 - _PARALLEL_SHARE + shared), 1),
        scene_bytes=round(
            forecast.scene_bytes + image_bytes - _COLOUR_BYTES_PER_FACE * forecast.faces
        ),
        work_bytes=round(forecast.work_bytes + image_bytes),
    )


def time_terms(ground: SolvedGround) -> tuple[float, float, float, float, float]:
    """Give what the time of a build is linear in.

    Returns
    -------
    tuple of float
        1; 1 where there are several tiles, which have processes of their own; points; faces; and
        pairs of points and neighbours that smoothing looks at.
    """
    several = 1.0 if ground.plan.count > 1 else 0.0
    pairs = ground.points * math.pi * ground.smoothing_spacings**2
    return 1.0, several, float(ground.points), _faces(ground), pairs


def _faces(ground: SolvedGround) -> float:
    by_normals = _NORMAL_FACTOR * ground.slant * ground.surface_m2 / ground.cell_m**2
    if ground.voxels is None:
        return _FACES_PER_VERTEX * by_normals
    by_voxels = _VOXEL_FACTOR * ground.voxels * (ground.voxel_m / ground.cell_m) ** 2
    slab = _NOISE_THICKNESS * ground.noise_m / (ground.voxel_m * ground.slant)
    weight = max(0.0, 1.0 - slab / _MOST_SLAB)
    return _FACES_PER_VERTEX * (weight * by_voxels + (1.0 - weight) * by_normals)
