"""The detail of a scene, segment by segment, cut to what is handed on.

Memory is that of one segment: every writer takes what it needs of it and goes on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from terraport_payload import PayloadError, SegmentMesh, Texture
from terraport_payload.types import AnyArray, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.export.selection import SelectedScene, Selection
from terraport_pipeline.geometry.mesh.box_clip import clip_to_box
from terraport_pipeline.published.scene_textures import colours_from_texture
from terraport_store import DamagedSceneError

__all__ = ["Piece", "read_pieces"]


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """What is handed on of one segment; V vertices, F faces."""

    segment: int
    positions: Float64
    """(V, 3) metres, scene frame."""
    faces: Int32
    """(F, 3) counter-clockwise seen from outside; at least one."""
    normals: Float32
    """(V, 3) unit, scene frame."""
    colours: UInt8 | None
    """(V, 3) sRGB; where there is a texture about what it shows there; None without both."""
    uvs: Float32 | None
    """(V, 2) 0..1 from the image's upper left."""
    texture: Texture | None
    regions: Int64
    """(F,) region of every face; -1 where the payload has none."""
    attributes: dict[str, Float32]
    """(V,) by name."""


def read_pieces(
    selected: SelectedScene,
    segments: Int64,
    *,
    cut: bool = True,
) -> Iterator[Piece]:
    """Read segments and cut them to a selection.

    Parameters
    ----------
    selected : SelectedScene
    segments : ndarray of int64
        Which to read; those of which nothing is left are not yielded.
    cut : bool
        Cut along the edges of the extent. False leaves faces whole: who looks at places within the
        extent alone needs no cut.

    Yields
    ------
    Piece

    Raises
    ------
    DamagedSceneError
        A payload fails its hash or does not decode.
    """
    scene, selection = selected.scene, selected.selection
    box = None
    if cut and selection.extent is not None:
        extent = selection.extent
        (x0, x1), (z1, z0) = selected.frame.ground(
            np.array([extent.xmin, extent.xmax]), np.array([extent.ymin, extent.ymax])
        )
        box = (float(x0), float(z0), float(x1), float(z1))
    for segment in segments.tolist():
        try:
            mesh = scene.mesh(segment)
        except PayloadError as error:
            raise DamagedSceneError(
                scene.manifest.files["segments.pack"].path,
                f"segment {segment}: {error}",
                offset=int(scene.index.offset[segment]),
            ) from None
        piece = _piece(segment, mesh, selection)
        if piece is not None and box is not None:
            piece = _cut(piece, box, scene.index.bounds[segment])
        if piece is not None:
            yield piece


def _piece(segment: int, mesh: SegmentMesh, selection: Selection) -> Piece | None:
    """Keep the faces of the regions wanted; None where there are none."""
    faces = mesh.faces.astype(np.int32)
    if mesh.region_ids is None:
        regions = np.full(len(faces), -1, np.int64)
    else:
        # Vertices on region borders are split: any corner tells.
        regions = mesh.region_ids[faces[:, 0]].astype(np.int64)
    if selection.regions is not None:
        keep = np.isin(regions, np.array(sorted(selection.regions), np.int64))
        faces, regions = faces[keep], regions[keep]
    if len(faces) == 0:
        return None
    textured = colours_from_texture(mesh)
    whole = Piece(
        segment,
        mesh.positions.astype(np.float64),
        faces,
        mesh.normals,
        mesh.colours if textured is None else textured,
        mesh.uvs,
        mesh.texture,
        regions,
        mesh.attributes,
    )
    used = np.unique(faces).astype(np.int64)
    return whole if len(used) == len(whole.positions) else _of_vertices(whole, used)


def _of_vertices(piece: Piece, used: Int64) -> Piece:
    """Drop the vertices that no face uses."""
    number = np.full(len(piece.positions), -1, np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    return Piece(
        piece.segment,
        piece.positions[used],
        number[piece.faces],
        piece.normals[used],
        None if piece.colours is None else piece.colours[used],
        None if piece.uvs is None else piece.uvs[used],
        piece.texture,
        piece.regions,
        {name: values[used] for name, values in piece.attributes.items()},
    )


def _cut(piece: Piece, box: tuple[float, float, float, float], bounds: Float32) -> Piece | None:
    """Cut along the edges of a box on the ground (least x and z, greatest x and z)."""
    if (bounds[[0, 2]] >= box[:2]).all() and (bounds[[3, 5]] <= box[2:]).all():
        return piece
    # Everything that is linear within a face follows the cut in one matrix.
    columns: list[AnyArray] = [piece.positions, piece.normals]
    if piece.colours is not None:
        columns.append(piece.colours)
    if piece.uvs is not None:
        columns.append(piece.uvs)
    columns += [values[:, None] for values in piece.attributes.values()]
    cut = clip_to_box(np.concatenate(columns, axis=1, dtype=np.float64), piece.faces, box)
    if len(cut.faces) == 0:
        return None
    positions, normals, *rest = np.split(
        cut.values, np.cumsum([column.shape[1] for column in columns])[:-1], axis=1
    )
    normals /= np.maximum(np.sqrt((normals * normals).sum(axis=1, keepdims=True)), 1e-12)
    colours = None if piece.colours is None else np.rint(rest.pop(0)).astype(np.uint8)
    uvs = None if piece.uvs is None else rest.pop(0).astype(np.float32)
    return Piece(
        piece.segment,
        positions,
        cut.faces,
        normals.astype(np.float32),
        colours,
        uvs,
        piece.texture,
        piece.regions[cut.face_before],
        {
            name: column[:, 0].astype(np.float32)
            for name, column in zip(piece.attributes, rest, strict=True)
        },
    )
