"""Meshes for their users: trimesh, the mixed model of a landing, GLB files."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from terraport.errors import MissingExtraError, UsageError
from terraport.textures import merge_textures, open_texture, vertex_colours
from terraport_payload import (
    AttributeScale,
    SegmentMesh,
    choose_attribute_scale,
    encode_glb,
    snap,
)
from terraport_payload.types import AnyFloat, AnyInt, Bool, Float32, Float64, Int64

if TYPE_CHECKING:
    import trimesh

    from terraport.base import BaseMesh

__all__ = ["concatenate", "mixed_model", "rim_heights", "to_trimesh", "write_glb"]

_SINK: Final = 1.5
"""Times the measured height: a face tilts as its corners sink by different amounts. Measured at the
rim of landings on two surveys: 1.0 leaves 133 and 21 base pixels per million of detail, 1.5 none
and 3."""
_GREY: Final = 160
"""sRGB of vertices without colour in a mesh of which others have one."""
_MAX_PAIRS: Final = 2_000_000
"""Pairs of a face and a vertex looked at together: about 400 MB of scratch."""
_MARGIN: Final = 0.05
"""Share of a face's size by which a vertex may lie beside it and still count."""
_MAX_CELLS: Final = 64
"""Columns that one face may take along each axis; larger faces make the columns wider."""


def to_trimesh(mesh: SegmentMesh) -> trimesh.Trimesh:
    """Return a mesh as a ``trimesh.Trimesh``; nothing is merged, reordered or repaired.

    Attributes go to ``vertex_attributes`` by their survey names, region ids as ``region_id``; a
    texture becomes a ``TextureVisuals`` (whose v points up).

    Raises
    ------
    MissingExtraError
        trimesh is not installed, or for a textured mesh Pillow.
    UsageError
        The texture is of a kind that Pillow cannot read.
    """
    try:
        import trimesh
    except ImportError:
        raise MissingExtraError("to_trimesh()", "trimesh") from None
    extra: dict[str, Any] = dict(mesh.attributes)
    if mesh.region_ids is not None:
        extra["region_id"] = mesh.region_ids
    return trimesh.Trimesh(
        vertices=mesh.positions,
        faces=mesh.faces,
        vertex_normals=mesh.normals,
        vertex_colors=mesh.colours,
        visual=_visual(mesh),
        vertex_attributes=extra,
        process=False,
    )


def _visual(mesh: SegmentMesh) -> Any:
    """Image and coordinates as trimesh holds them; None without."""
    if mesh.uvs is None or mesh.texture is None:
        return None
    from trimesh import visual

    untyped: Any = visual
    material = untyped.material.PBRMaterial(
        baseColorTexture=open_texture(mesh.texture),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    upwards = np.column_stack([mesh.uvs[:, 0], 1.0 - mesh.uvs[:, 1]])
    return untyped.TextureVisuals(uv=upwards, material=material)


def mixed_model(
    base: BaseMesh,
    segments: Mapping[int, SegmentMesh],
    hidden_faces: Bool,
    *,
    sink_rim_m: float = 0.0,
    push_back_m: float = 0.0,
    eye: Sequence[float] | None = None,
) -> SegmentMesh:
    """Return what a viewer draws at a landing: the base less its hidden faces, and the detail.

    Parameters
    ----------
    base : BaseMesh
        Of the same scene version as the segments.
    segments : mapping of int to SegmentMesh
        Every segment that is shown, by id.
    hidden_faces : ndarray of shape (B,), bool
        Base faces that are hidden then: the landing's or the session's ``hidden_faces``.
    sink_rim_m : float
        How far at most, in metres against their normals, to move the vertices of base faces that
        segments cover in part, so that the base does not poke through the detail at the rim. Each
        moves half as far again as its faces stand over the segments' vertices below them. For
        files, to be seen from anywhere; the manifest's ``hand_off.deviation_m`` is right.
    push_back_m, eye : float, sequence of 3 floats
        How far to move the whole base away from an eye, along the lines of sight. For pictures from
        that eye: no outline changes by it, and no step opens; ``hand_off.deviation_m`` again.

    Returns
    -------
    SegmentMesh
        Attributes and colours are kept where any part has them; NaN and grey fill the others. Of
        textures see :func:`concatenate`.

    Raises
    ------
    UsageError
        A distance is negative or not finite, or `push_back_m` comes without `eye`.
    MissingExtraError
        Parts have textures, and Pillow is not installed.

    References
    ----------
    ``docs/topics/hand-off.md``, "The rim".
    """
    for name, distance_m in (("sink_rim_m", sink_rim_m), ("push_back_m", push_back_m)):
        if not (np.isfinite(distance_m) and distance_m >= 0):
            raise UsageError(f"{name} is {distance_m}, expected 0 or more")
    if push_back_m and eye is None:
        raise UsageError(f"push_back_m is {push_back_m} without eye, expected both")
    positions = base.mesh.positions
    if sink_rim_m and segments:
        positions = _sunk(base.mesh, ~hidden_faces, segments.values(), sink_rim_m)
    if push_back_m and eye is not None:
        sight = positions - np.asarray(eye, dtype=np.float64)
        length = np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), np.finfo(float).tiny)
        positions = (positions + sight / length * push_back_m).astype(np.float32)
    faces = base.mesh.faces[~hidden_faces]
    drawn = _without_unused(replace(base.mesh, positions=positions, faces=faces))
    # Without a face left it would bring its whole image for nothing.
    return concatenate([drawn, *segments.values()] if len(drawn.faces) else segments.values())


def concatenate(meshes: Iterable[SegmentMesh]) -> SegmentMesh:
    """Return several meshes as one; vertices are not merged.

    Where some have colours, region ids or an attribute and others do not, the others get grey,
    0 and NaN. Where all have textures, their images become one of at most 4096 x 4096, halved
    until they fit; where only some have, every vertex gets the colour of its texel. No mesh at all
    gives an empty one.

    Raises
    ------
    MissingExtraError
        Several meshes, some with textures, and Pillow is not installed.
    UsageError
        A texture is of a kind that Pillow cannot read, or there are too many.
    """
    # Invariant: every array has a row for each vertex of each piece, in the order of the pieces.
    # (1) One kind of colour for all: an atlas, or a colour a vertex.
    pieces = list(meshes)
    uvs = texture = None
    if pieces and all(piece.texture is not None for piece in pieces):
        uvs, texture = merge_textures(pieces)
    elif any(piece.texture is not None for piece in pieces):
        pieces = [
            replace(piece, colours=vertex_colours(piece), uvs=None, texture=None)
            for piece in pieces
        ]
    if not pieces:
        nothing = np.zeros((0, 3), dtype=np.float32)
        return SegmentMesh(nothing, np.zeros((0, 3), dtype=np.uint32), nothing)
    # (2) Faces count on from the vertices before; what a piece lacks is filled up.
    starts = np.cumsum([0, *(len(piece.positions) for piece in pieces[:-1])])
    names = list(dict.fromkeys(name for piece in pieces for name in piece.attributes))

    def joined(values: Callable[[SegmentMesh], Any], fill: Any) -> Any:
        """Join an array of every piece; a row of `fill` for each vertex of those without it."""
        found = [values(piece) for piece in pieces]
        if all(value is None for value in found):
            return None
        return np.concatenate(
            [
                np.tile(fill, (len(piece.positions),) + (1,) * np.ndim(fill))
                if value is None
                else value
                for piece, value in zip(pieces, found, strict=True)
            ]
        )

    return SegmentMesh(
        positions=np.concatenate([piece.positions for piece in pieces]),
        faces=np.concatenate(
            [piece.faces + np.uint32(start) for piece, start in zip(pieces, starts, strict=True)]
        ),
        normals=np.concatenate([piece.normals for piece in pieces]),
        colours=joined(lambda piece: piece.colours, np.full(3, _GREY, np.uint8)),
        region_ids=joined(lambda piece: piece.region_ids, np.uint16(0)),
        attributes={name: joined(partial(_attribute, name), np.float32(np.nan)) for name in names},
        uvs=uvs,
        texture=texture,
    )


def _attribute(name: str, mesh: SegmentMesh) -> Float32 | None:
    return mesh.attributes.get(name)


def write_glb(
    mesh: SegmentMesh,
    path: str | Path,
    *,
    step_m: float,
    attribute_scales: Mapping[str, AttributeScale] | None = None,
) -> int:
    """Write a mesh as a GLB file, compressed as the scene's own payloads are.

    Parameters
    ----------
    mesh : SegmentMesh
        Positions are snapped to the grid first (a rim that was sunk is not on it).
    path : Path
        Replaced if it is there, in one step: a failure leaves it as it was.
    step_m : float
        Grid step of the scene, metres; its manifest has it.
    attribute_scales : mapping, optional
        By survey name; what is not given is chosen from the values.

    Returns
    -------
    int
        Bytes written.

    Raises
    ------
    terraport_payload.PayloadError
        The mesh cannot be encoded, for example because it is empty.
    OSError
        The file cannot be written.
    """
    scales = dict(attribute_scales or {})
    for name, values in mesh.attributes.items():
        if name not in scales:
            scales[name] = choose_attribute_scale(values)
    on_grid = replace(mesh, positions=snap(mesh.positions, step_m))
    data = encode_glb(on_grid, step_m=step_m, attribute_scales=scales)
    target = Path(path)
    beside = target.with_name(f".{target.name}.tmp")
    try:
        beside.write_bytes(data)
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)
    return len(data)


def _sunk(
    base: SegmentMesh, drawn: Bool, segments: Iterable[SegmentMesh], most_m: float
) -> Float32:
    """Return the base's positions, those of drawn faces over detail lowered below it."""
    points = np.concatenate([segment.positions for segment in segments])
    corners = base.positions[base.faces]
    is_near = (corners.max(axis=1) >= points.min(axis=0) - most_m).all(axis=1)
    is_near &= (corners.min(axis=1) <= points.max(axis=0) + most_m).all(axis=1)
    height = rim_heights(base.positions, base.faces[drawn & is_near], points, most_m=most_m)
    depth = np.minimum(height * np.float32(_SINK), np.float32(most_m))
    lowered: Float32 = base.positions - depth[:, None] * base.normals
    return lowered


def _without_unused(mesh: SegmentMesh) -> SegmentMesh:
    """Return the mesh without vertices that no face uses."""
    used = np.zeros(len(mesh.positions), dtype=np.bool_)
    used[mesh.faces] = True
    index = np.cumsum(used, dtype=np.uint32) - np.uint32(1)

    def kept(values: Any) -> Any:
        return None if values is None else values[used]

    return SegmentMesh(
        positions=mesh.positions[used],
        faces=index[mesh.faces].reshape(-1, 3),
        normals=mesh.normals[used],
        colours=kept(mesh.colours),
        region_ids=kept(mesh.region_ids),
        attributes={name: kept(values) for name, values in mesh.attributes.items()},
        uvs=kept(mesh.uvs),
        texture=mesh.texture,
    )


def rim_heights(
    vertices: AnyFloat,
    faces: AnyInt,
    points: AnyFloat,
    *,
    most_m: float,
) -> Float32:
    """Measure how far to lower the vertices of rim faces, so that none stands over the detail.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Of the base, metres, Y up.
    faces : ndarray of shape (K, 3), integer
        The rim's faces, counter-clockwise seen from above the ground.
    points : ndarray of shape (P, 3), float
        Vertices of the loaded detail, metres, the same frame.
    most_m : float
        Detail further below or above a face than this belongs to something else (another storey),
        and nothing is lowered further.

    Returns
    -------
    ndarray of shape (V,), float32
        Metres, 0 to `most_m`: for each vertex the largest height of any face around it over a point
        that lies straight (along the face's normal) below that face. 0 away from the rim.

    Notes
    -----
    Faces and points meet in square columns as wide as the median face; linear in what meets.
    """
    out = np.zeros(len(vertices), dtype=np.float32)
    if len(faces) == 0 or len(points) == 0 or not most_m > 0:
        return out
    corner = np.asarray(vertices, dtype=np.float64)[faces]
    detail = np.asarray(points, dtype=np.float64)
    height = np.zeros(len(faces))
    for face, point in _meetings(corner, detail, most_m):
        above = _heights(corner[face], detail[point])
        within = (above > 0) & (above <= most_m)
        np.maximum.at(height, face[within], above[within])
    np.maximum.at(out, faces.ravel(), np.repeat(height, 3).astype(np.float32))
    return out


def _meetings(corner: Float64, detail: Float64, most_m: float) -> Iterator[tuple[Int64, Int64]]:
    """Pair each face with the points in the columns that it touches, in bounded portions."""
    flat = corner[:, :, [0, 2]]
    low, high = flat.min(axis=1) - most_m, flat.max(axis=1) + most_m
    width = max(float(np.median(high - low)), float((high - low).max()) / _MAX_CELLS, 1e-6)
    origin = low.min(axis=0)
    reach = (high.max(axis=0) - origin) / width
    columns = reach.astype(np.int64) + 1
    # points by column
    cell = np.floor((detail[:, [0, 2]] - origin) / width).astype(np.int64)
    inside = np.flatnonzero(((cell >= 0) & (cell < columns)).all(axis=1))
    key = cell[inside, 0] * columns[1] + cell[inside, 1]
    order = np.argsort(key, kind="stable")
    inside, key = inside[order], key[order]
    # columns of every face
    first = np.floor((low - origin) / width).astype(np.int64)
    count = np.floor((high - origin) / width).astype(np.int64) - first + 1
    total = count[:, 0] * count[:, 1]
    face = np.repeat(np.arange(len(corner)), total)
    step = np.arange(len(face)) - np.repeat(np.cumsum(total) - total, total)
    wanted = (first[face, 0] + step // count[face, 1]) * columns[1]
    wanted += first[face, 1] + step % count[face, 1]
    start = np.searchsorted(key, wanted, side="left")
    length = np.searchsorted(key, wanted, side="right") - start
    ends = np.cumsum(length)
    cuts = np.searchsorted(ends, np.arange(_MAX_PAIRS, int(ends[-1]), _MAX_PAIRS))
    for begin, end in itertools.pairwise(np.unique([0, *cuts, len(face)])):
        each = length[begin:end]
        within = np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each)
        point = inside[np.repeat(start[begin:end], each) + within]
        yield np.repeat(face[begin:end], each), point


def _heights(corner: Float64, detail: Float64) -> Float64:
    """Height of each face over its point along the face's normal; -inf where it lies beside it."""
    edge, other = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    normal = np.cross(edge, other)
    area = np.einsum("ij,ij->i", normal, normal)
    safe = np.where(area > 0, area, 1.0)
    away = detail - corner[:, 0]
    # Barycentric weights of the foot of the perpendicular (Ericson, Real-Time Collision, 3.4).
    v = np.einsum("ij,ij->i", np.cross(away, other), normal) / safe
    w = np.einsum("ij,ij->i", np.cross(edge, away), normal) / safe
    beside = (v < -_MARGIN) | (w < -_MARGIN) | (v + w > 1 + _MARGIN) | (area <= 0)
    above: Float64 = -np.einsum("ij,ij->i", away, normal) / np.sqrt(safe)
    above[beside] = -np.inf
    return above
