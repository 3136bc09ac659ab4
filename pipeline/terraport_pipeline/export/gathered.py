"""All pieces of a selection in one mesh: what formats need that count vertices through.

Border vertices stand once in each segment, and once for each region; here they are one again, so
that other tools find a closed surface.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from terraport_payload import Texture
from terraport_payload.types import Bool, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.errors import ResourceError
from terraport_pipeline.export.pieces import Piece, read_pieces
from terraport_pipeline.export.selection import SelectedScene, choose_segments
from terraport_pipeline.progress import Progress

__all__ = ["MAX_MESH_FACES", "GatheredMesh", "gather_mesh", "has_three_corners"]

MAX_MESH_FACES: Final = 30_000_000
"""Largest mesh in one file: some 6 GB while it is written, and more than most programs open."""


@dataclass(frozen=True, slots=True, eq=False)
class GatheredMesh:
    """V vertices, F faces, of all segments one after the other."""

    positions: Float64
    """(V, 3) metres, scene frame."""
    faces: Int32
    """(F, 3) counter-clockwise seen from outside."""
    normals: Float32
    """(V, 3) unit, scene frame."""
    colours: UInt8 | None
    """(V, 3) sRGB; None where the scene has none."""
    uvs: Float32 | None
    """(V, 2) 0..1 from the image's upper left; None without any texture."""
    texture_faces: list[tuple[Texture | None, slice]] = field(default_factory=list)
    """Runs of faces with the texture that they show, in order."""


def gather_mesh(selected: SelectedScene, progress: Progress) -> GatheredMesh:
    """Read what is selected, cut along the edges of its extent.

    Parameters
    ----------
    selected : SelectedScene
    progress : Progress
        A step of segments.

    Raises
    ------
    ResourceError
        It has more faces than a file of one mesh should.
    """
    # (1) Refuse by the index, before anything is read.
    segments = choose_segments(selected)
    count = int(selected.scene.index.face_count[segments].sum(dtype=np.int64))
    if count > MAX_MESH_FACES:
        raise ResourceError(
            f"a mesh of up to {count:,} triangles, expected at most {MAX_MESH_FACES:,} in one "
            "file; export it in several, by --extent or --region"
        )
    # (2) Pieces as they come.
    progress.start("read segments", len(segments), "segments")
    pieces: list[Piece] = []
    before = 0
    for piece in read_pieces(selected, segments):
        pieces.append(piece)
        progress.advance(max(0, int(np.searchsorted(segments, piece.segment)) + 1 - before))
        before = int(np.searchsorted(segments, piece.segment)) + 1
    faces = sum(len(piece.faces) for piece in pieces)
    progress.done({"triangles": faces})
    return _joined(pieces)


def _joined(pieces: list[Piece]) -> GatheredMesh:
    starts = np.cumsum([0, *(len(piece.positions) for piece in pieces)])
    runs: list[tuple[Texture | None, slice]] = []
    first = 0
    for piece in pieces:
        runs.append((piece.texture, slice(first, first + len(piece.faces))))
        first += len(piece.faces)
    textured = any(piece.texture is not None for piece in pieces)
    coloured = any(piece.colours is not None for piece in pieces)
    return GatheredMesh(
        np.concatenate([piece.positions for piece in pieces] or [np.zeros((0, 3))]),
        np.concatenate(
            [
                piece.faces + np.int32(start)
                for piece, start in zip(pieces, starts.tolist(), strict=False)
            ]
            or [np.zeros((0, 3), np.int32)]
        ),
        np.concatenate([piece.normals for piece in pieces] or [np.zeros((0, 3), np.float32)]),
        np.concatenate([_colours(piece) for piece in pieces]) if coloured else None,
        np.concatenate([_uvs(piece) for piece in pieces]) if textured else None,
        runs,
    )


def _colours(piece: Piece) -> UInt8:
    if piece.colours is None:
        return np.full((len(piece.positions), 3), 150, np.uint8)
    return piece.colours


def _uvs(piece: Piece) -> Float32:
    if piece.uvs is None:
        return np.zeros((len(piece.positions), 2), np.float32)
    return piece.uvs


def has_three_corners(faces: Int64) -> Bool:
    """Tell which faces (F, 3) have three different corners.

    A scene's grid puts the corners of the smallest triangles at one place; once these are one
    vertex, other programs drop such a face, or stumble over it.
    """
    a, b, c = faces.T
    different: Bool = (a != b) & (b != c) & (c != a)
    return different
