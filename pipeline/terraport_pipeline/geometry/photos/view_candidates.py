"""Which photos could colour a face, and how well each would.

One photo after another is taken through three steps: vertices are projected, faces that lie wholly
inside the picture and look at the camera are rated, and those that nothing hides are put among the
best few of their face. So photos are loaded once, and memory is bounded by faces times
:data:`SLOTS`, however many photos there are.

The rating (the data term of Waechter, Moehrle, Goesele, "Let There Be Color! Large-Scale Texturing
of 3D Reconstructions", ECCV 2014, section 4.1) is::

    quality = projected area in pixels * cos(angle to the face's normal) * sharpness

where they integrate the gradient magnitude over the projected face. The faces of a dense survey
cover a few pixels, where that integral is mostly noise and likes whatever is rough; here the
sharpness is that of the surroundings (see :mod:`terraport_pipeline.geometry.sharpness`).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from terraport_payload.types import Bool, Float32, Float64, Int16, Int32, Int64, UInt8, UInt16
from terraport_pipeline.geometry.mesh.chunks import CHUNK, in_chunks
from terraport_pipeline.geometry.mesh.mesh_blocks import MeshBlocks
from terraport_pipeline.geometry.photos import view_kernels as kernels
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.geometry.photos.view_kernels import QUALITY_STEPS, SLOTS, face_radii

__all__ = [
    "QUALITY_STEPS",
    "SLOTS",
    "Candidates",
    "Rated",
    "face_radii",
    "insert",
    "median_area",
    "new_candidates",
    "project_blocks",
    "rate_faces",
    "sorted_by_view",
    "visible_blocks",
]


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """The best views of each face by quality, in a fixed number of slots."""

    view: Int16
    """(F, SLOTS) view, -1 in empty places."""
    quality: UInt16
    """(F, SLOTS) logarithm of the quality in steps, 1 at least; 0 in empty places."""
    colour: UInt8
    """(F, SLOTS, 3) sRGB of the face in that view, after the view's gain."""


@dataclass(frozen=True, slots=True, eq=False)
class Rated:
    """Faces that one photo may show; C of them, in face order."""

    face: Int32
    """(C,)"""
    quality: Float32
    """(C,) see the module."""
    area: Float32
    """(C,) square pixels."""


def new_candidates(n_faces: int) -> Candidates:
    """Make empty candidates for so many faces; 56 bytes each."""
    return Candidates(
        np.full((n_faces, SLOTS), -1, np.int16),
        np.zeros((n_faces, SLOTS), np.uint16),
        np.zeros((n_faces, SLOTS, 3), np.uint8),
    )


def visible_blocks(blocks: MeshBlocks, view: View) -> npt.NDArray[np.intp]:
    """Find blocks that the cone around a photo touches, ascending.

    The cone holds the rays of the picture's rim; where the lens cannot tell (a rim beyond its valid
    radius) it is taken as half of space.
    """
    lens = view.lens
    u = np.linspace(0.0, lens.width, 17)
    v = np.linspace(0.0, lens.height, 17)
    rim = np.concatenate(
        [np.stack(pair, axis=1) for pair in (
            (u, np.zeros(17)), (u, np.full(17, lens.height)),
            (np.zeros(17), v), (np.full(17, lens.width), v),
        )]
    )  # fmt: skip
    cosine = lens.unproject(rim)[:, 2]
    widest = 0.5 * np.pi
    if np.isfinite(cosine).all():
        widest = min(widest, float(np.arccos(np.clip(cosine.min(), -1.0, 1.0))) + 0.01)
    towards = blocks.spheres[:, :3] - view.position
    distance = np.linalg.norm(towards, axis=1)
    radius = blocks.spheres[:, 3]
    ahead = towards @ view.rotation[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        off_axis = np.arccos(np.clip(ahead / distance, -1.0, 1.0))
        half = np.arcsin(np.clip(radius / distance, 0.0, 1.0))
    inside = (distance <= radius) | (off_axis <= widest + half)
    return np.flatnonzero((radius >= 0.0) & inside)


def project_blocks(
    blocks: MeshBlocks,
    packed: Float64,
    seen: npt.NDArray[np.intp],
    uv: Float32,
    *,
    threads: int = 1,
) -> None:
    """Write the pixels of the vertices of blocks seen to `uv`, (V, 2) float32; else NaN."""
    uv[:] = np.nan
    pieces = _pieces(blocks.vertex_starts, seen)
    vertices = blocks.vertices

    def work(begin: int, end: int) -> None:
        for first, last in pieces[begin:end]:
            kernels.project(packed, vertices, uv, first, last)

    in_chunks(work, len(pieces), threads=threads, chunk=8)


def median_area(
    blocks: MeshBlocks, packed: Float64, seen: npt.NDArray[np.intp], uv: Float32
) -> float:
    """Median projected area of faces inside a photo, square pixels, from a sample; 0: none."""
    samples = [
        kernels.sample_areas(packed, blocks.faces, uv, first, last)
        for first, last in _pieces(blocks.face_starts, seen)
    ]
    areas = np.concatenate(samples) if samples else np.zeros(0)
    return float(np.median(areas)) if len(areas) else 0.0


def rate_faces(
    blocks: MeshBlocks,
    packed: Float64,
    seen: npt.NDArray[np.intp],
    uv: Float32,
    sharpness: Float32,
    candidates: Candidates,
    *,
    min_cosine: float,
    threads: int = 1,
) -> Rated:
    """Rate the faces that lie inside a photo, look at it, and would be among their best.

    Parameters
    ----------
    blocks : MeshBlocks
    packed : ndarray of shape (PACKED,), float64
        The view.
    seen : ndarray of int
        Blocks to look at.
    uv : ndarray of shape (V, 2), float32
        From :func:`project_blocks`.
    sharpness : ndarray of shape (H', W'), float32
        Positive factor of the quality over the picture, of any resolution.
    candidates : Candidates
        What is known so far: a face whose places are all taken by better views is left out.
    min_cosine : float
        Faces seen at flatter angles are left out.
    threads : int

    Returns
    -------
    Rated
    """
    pieces = _pieces(blocks.face_starts, seen)
    worst = candidates.quality

    def work(begin: int, end: int) -> list[tuple[Int32, Float32, Float32]]:
        return [
            kernels.rate(
                packed, blocks.vertices, blocks.faces, uv, sharpness, worst, min_cosine, first, last
            )
            for first, last in pieces[begin:end]
        ]

    columns = [
        rows for chunk in in_chunks(work, len(pieces), threads=threads, chunk=8) for rows in chunk
    ]
    if not columns:
        return Rated(np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros(0, np.float32))
    return Rated(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def insert(
    candidates: Candidates,
    view: int,
    rated: Rated,
    visible: Bool,
    colours: UInt8,
    *,
    threads: int = 1,
) -> None:
    """Put a photo among the best of the faces it shows.

    Parameters
    ----------
    candidates : Candidates
        Written to.
    view : int
        Views must come in ascending order. One only as good as the worst of a face is left out.
    rated : Rated
        C faces.
    visible : ndarray of shape (C,), bool
    colours : ndarray of shape (C, 3), uint8
        The faces' colours in this photo.
    """

    def work(begin: int, end: int) -> None:
        kernels.insert(
            candidates.view, candidates.quality, candidates.colour,
            view, rated.face, rated.quality, visible, colours, begin, end,
        )  # fmt: skip

    # Every face occurs once, so no two pieces write to one place.
    in_chunks(work, len(rated.face), threads=threads)


def sorted_by_view(candidates: Candidates, *, threads: int = 1) -> None:
    """Sort the places of every face by view, the empty ones last; in place."""

    def work(begin: int, end: int) -> None:
        kernels.sort_slots(candidates.view, candidates.quality, candidates.colour, begin, end)

    in_chunks(work, len(candidates.view), threads=threads)


def _pieces(starts: Int64, seen: npt.NDArray[np.intp]) -> list[tuple[int, int]]:
    """Ranges of items of the blocks, neighbouring blocks in one, none longer than a chunk or so."""
    pieces: list[tuple[int, int]] = []
    for block in seen.tolist():
        first, last = int(starts[block]), int(starts[block + 1])
        if first == last:
            continue
        if pieces and pieces[-1][1] == first and last - pieces[-1][0] <= CHUNK // 8:
            pieces[-1] = (pieces[-1][0], last)
        else:
            pieces.append((first, last))
    return pieces
