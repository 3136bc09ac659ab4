"""The coarser level of a segment: fewer faces, the same border bit for bit.

A client shows one level of each segment, any mix of them side by side. Nothing opens between two,
because the border of a segment (every edge with a face of it on one side alone) is the same at each
level, vertex by vertex: no simplifier touches it, and :func:`coarser` looks that this is so. Hence
a level is made of its segment alone, without a look at its neighbours.

What lies inside is thinned by quadric error (:mod:`.decimate`). A vertex that stays takes the mean
colour and the mean attributes of all that went into it, weighted alike; one on the border keeps its
own, so that colours meet, too. Of a texture the same charts are kept, their outlines held as the
border is, and the image is halved.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
import PIL.Image

from terraport_payload import SegmentMesh, Texture
from terraport_payload.types import AnyArray, Bool, Float32, Int32, Int64, UInt8
from terraport_pipeline.engines.decimate import decimate_tracked
from terraport_pipeline.engines.images import MEDIA_TYPES, decode_image, encode_image
from terraport_pipeline.errors import EngineError
from terraport_pipeline.options.texture import ImageFormat

__all__ = ["FACE_SHARE", "coarser", "levels_of", "odd_edges"]

FACE_SHARE: Final = 0.2
"""Faces of the coarser level, of those of the segment. A held border alone needs 0.11."""

_IMAGE_QUALITY: Final = 80
"""Of the halved image."""

_KINDS: Final[dict[str, ImageFormat]] = {
    MEDIA_TYPES[kind]: kind for kind in ("jpeg", "webp", "png")
}


def levels_of(mesh: SegmentMesh, levels: int) -> Iterator[SegmentMesh]:
    """Give a segment at every level, the finest first."""
    yield mesh
    for _ in range(1, levels):
        mesh = coarser(mesh)
        yield mesh


def coarser(mesh: SegmentMesh, face_share: float = FACE_SHARE) -> SegmentMesh:
    """Make the coarser level of one segment.

    Parameters
    ----------
    mesh : SegmentMesh
    face_share : float
        Of the faces to keep, about; more are left where the border alone needs more.

    Returns
    -------
    SegmentMesh
        With the same border and box. The segment as it is, but for a smaller image, where the
        simplifier does not hold the border.

    Raises
    ------
    EngineError
        The segment has a KTX2 texture, which nothing here can halve.
    """
    # (1) One vertex a place, and for textures one a place and chart: a seam is held as a border is.
    columns = mesh.positions if mesh.uvs is None else np.hstack([mesh.positions, mesh.uvs])
    _, first, place = np.unique(_rows(columns), return_index=True, return_inverse=True)
    place = place.reshape(-1)
    faces = _proper(place[mesh.faces.astype(np.int64)].astype(np.int32))
    texture = None if mesh.texture is None else _halved(mesh.texture)
    # (2) Thinned inside.
    points, thinned, merged_into = decimate_tracked(
        mesh.positions[first].astype(np.float64),
        faces,
        max_faces=max(2, round(len(mesh.faces) * face_share)),
    )
    positions = points.astype(np.float32)
    fixed = np.zeros(len(first), np.bool_)
    fixed[odd_edges(faces)] = True
    # Of each vertex that stays: the one of the border that went into it, else the nearest.
    into = merged_into[place]  # -1: of a vertex without a face
    distance = np.linalg.norm(mesh.positions - positions[into], axis=1) - fixed[place]
    order = np.lexsort((distance, into))
    order = order[into[order] >= 0]
    kept, at = np.unique(into[order], return_index=True)
    source = np.full(len(points), -1, np.int64)
    source[kept] = order[at]
    used = np.unique(thinned)
    if (
        not len(thinned)
        or (source[used] < 0).any()
        or not _same_border(mesh.positions[first], faces, positions, thinned)
    ):
        return replace(mesh, texture=texture)
    is_fixed = fixed[place[source]] & (source >= 0)
    positions[is_fixed] = mesh.positions[source[is_fixed]]
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    positions = np.clip(positions, low, high)  # the box of a segment is that of its levels
    # (3) Its colours, attributes, region.
    whole = SegmentMesh(
        positions=positions,
        faces=thinned.astype(np.uint32),
        normals=_unit(_mean(mesh.normals, into, source, is_fixed)),
        colours=None
        if mesh.colours is None
        else _bytes(_mean(mesh.colours, into, source, is_fixed)),
        region_ids=None if mesh.region_ids is None else mesh.region_ids[source],
        attributes={
            name: _mean(values, into, source, is_fixed).astype(np.float32)
            for name, values in mesh.attributes.items()
        },
        uvs=None if mesh.uvs is None else mesh.uvs[source],
        texture=texture,
    )
    return _split(whole)


def odd_edges(faces: Int32) -> Int64:
    """Find the border: edges that an odd number of faces use, (E, 2), ascending.

    Faces that use a vertex twice have none.
    """
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    ends.sort(axis=1)
    edges, counts = np.unique(ends, axis=0, return_counts=True)
    odd: Int64 = edges[counts % 2 == 1]
    return odd


def _same_border(before: Float32, faces: Int32, after: Float32, thinned: Int32) -> bool:
    own, other = before[odd_edges(faces)], after[odd_edges(thinned)]
    if len(own) != len(other):
        return False
    return np.array_equal(_sorted_edges(own), _sorted_edges(other))


def _sorted_edges(ends: Float32) -> AnyArray:
    """Order edges (E, 2, 3) so that equal sets are equal arrays."""
    names = _rows(ends.reshape(-1, 3)).reshape(-1, 2)
    names = np.sort(names, axis=1)
    ordered: AnyArray = names[np.lexsort((names[:, 1], names[:, 0]))]
    return ordered


def _rows(values: AnyArray) -> AnyArray:
    """Name each row by a number, so that equal rows have equal names; of two arrays too."""
    table = np.ascontiguousarray(values + np.float32(0.0), np.float32)  # one zero, not two
    fields: Any = [(str(column), np.uint32) for column in range(table.shape[1])]
    named: AnyArray = table.view(np.uint32).view(fields).reshape(-1)
    return named


def _proper(faces: Int32) -> Int32:
    a, b, c = faces.T
    return np.ascontiguousarray(faces[(a != b) & (b != c) & (c != a)])


def _mean(values: AnyArray, into: Int64, source: Int64, fixed: Bool) -> AnyArray:
    """Average what went into each vertex; those of the border keep their own."""
    table = values.reshape(len(values), -1).astype(np.float64)
    present = ~np.isnan(table)
    out = np.empty((len(source), table.shape[1]))
    for column in range(table.shape[1]):
        some = present[:, column] & (into >= 0)
        count = np.bincount(into[some], minlength=len(source))
        total = np.bincount(into[some], table[some, column], minlength=len(source))
        out[:, column] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    out[fixed] = table[source[fixed]]
    return out.reshape(len(source), *values.shape[1:])


def _unit(normals: AnyArray) -> Float32:
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    up = np.array([0.0, 1.0, 0.0])
    return np.where(length > 1e-9, normals / np.maximum(length, 1e-9), up).astype(np.float32)


def _bytes(colours: AnyArray) -> UInt8:
    whole: UInt8 = np.rint(np.nan_to_num(colours)).clip(0, 255).astype(np.uint8)
    return whole


def _split(mesh: SegmentMesh) -> SegmentMesh:
    """Give each face one region, of most of its corners or the lowest; drop loose vertices."""
    corners = mesh.faces.astype(np.int64)
    regions = np.zeros(len(mesh.positions), np.int64)
    if mesh.region_ids is not None:
        regions = mesh.region_ids.astype(np.int64)
    three = np.sort(regions[corners], axis=1)
    of_face = np.where(three[:, 1] == three[:, 2], three[:, 1], three[:, 0])
    span = int(regions.max(initial=0)) + 1
    unique, corner = np.unique(corners * span + of_face[:, None], return_inverse=True)
    vertex, region = np.divmod(unique, span)
    return SegmentMesh(
        positions=mesh.positions[vertex],
        faces=corner.reshape(-1, 3).astype(np.uint32),
        normals=mesh.normals[vertex],
        colours=None if mesh.colours is None else mesh.colours[vertex],
        region_ids=None if mesh.region_ids is None else region.astype(np.uint16),
        attributes={name: values[vertex] for name, values in mesh.attributes.items()},
        uvs=None if mesh.uvs is None else mesh.uvs[vertex],
        texture=mesh.texture,
    )


def _halved(texture: Texture) -> Texture:
    kind = _KINDS.get(texture.media_type)
    if kind is None:
        raise EngineError(
            f"a texture of {texture.media_type}; expected JPEG, WebP or PNG for a coarser level"
        )
    image = PIL.Image.fromarray(decode_image(texture.data))
    sides = (max(1, texture.width // 2), max(1, texture.height // 2))
    smaller = np.asarray(image.resize(sides, PIL.Image.Resampling.BOX))
    return Texture.of(encode_image(smaller, kind, _IMAGE_QUALITY))
