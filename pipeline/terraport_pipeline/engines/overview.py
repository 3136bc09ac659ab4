"""The overview of a base: so small that it is the first thing of a scene that a client shows.

Its shape is the base's, decimated further (:mod:`~terraport_pipeline.engines.decimate`); its
colours are means of the base's over the ground that each vertex stands for.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload import SegmentMesh, decode_segment, encode_segment, snap
from terraport_payload.types import Bool, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.engines.decimate import decimate
from terraport_pipeline.engines.images import decode_image
from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals
from terraport_pipeline.geometry.segments.strip_order import strip_order

__all__ = ["MAX_FACES", "MIN_BASE_BYTES", "overview_of", "overview_payload"]

MAX_FACES: Final = 20_000
"""80 to 110 kB with colours and regions: the page itself has three times as many."""

MIN_BASE_BYTES: Final = 256 << 10
"""A smaller base is there as soon as its overview would be, and has none."""


def overview_payload(base_payload: bytes, step_m: float) -> bytes | None:
    """Make ``overview.tsg`` of a base that is written.

    Parameters
    ----------
    base_payload : bytes
        ``base.tsg``.
    step_m : float
        Grid step of the scene, metres.

    Returns
    -------
    bytes or None
        None where the base is small, has no more faces than its overview would, or has an image
        that nothing here decodes (KTX2).
    """
    if len(base_payload) < MIN_BASE_BYTES:
        return None
    base = decode_segment(base_payload, scales=None)
    is_opaque = base.texture is not None and base.texture.media_type == "image/ktx2"
    if len(base.faces) <= MAX_FACES or is_opaque:
        return None
    overview = overview_of(base, step_m)
    ordered = replace(overview, faces=overview.faces[strip_order(overview.faces)])
    return encode_segment(ordered, step_m=step_m, scales={}, may_be_wide=True)


def overview_of(base: SegmentMesh, step_m: float, max_faces: int = MAX_FACES) -> SegmentMesh:
    """Make the overview of a base.

    Parameters
    ----------
    base : SegmentMesh
        With vertex colours, a texture that Pillow decodes, or neither.
    step_m : float
        Grid step of the scene, metres.
    max_faces : int
        About as many it gets; more where the base's rim alone needs them.

    Returns
    -------
    SegmentMesh
        On the grid, with vertex colours (those of the texture, too) and regions where the base has
        them; without attributes. No vertex is split along regions: each has that of the nearest
        vertex of the base.
    """
    corners, corner = np.unique(base.positions, axis=0, return_inverse=True)
    joined = corner.reshape(-1)[base.faces].astype(np.int32)
    vertices, faces = decimate(corners, _proper(joined), max_faces=max_faces)
    vertices, faces = _on_grid(vertices, faces, step_m)
    tree = cKDTree(vertices)
    return SegmentMesh(
        positions=vertices,
        faces=faces.astype(np.uint32),
        normals=vertex_normals(vertices, faces),
        colours=_mean_colours(base, vertices, tree),
        region_ids=None
        if base.region_ids is None
        else base.region_ids[cKDTree(base.positions).query(vertices)[1]],
    )


def _proper(faces: Int32) -> Int32:
    a, b, c = faces.T
    kept: Bool = (a != b) & (b != c) & (c != a)
    return np.ascontiguousarray(faces[kept])


def _on_grid(vertices: Float32, faces: Int32, step_m: float) -> tuple[Float32, Int32]:
    """Move vertices to the grid, unite those that meet there, and leave out what no face uses."""
    points, place = np.unique(snap(vertices, step_m), axis=0, return_inverse=True)
    faces = _proper(place.reshape(-1)[faces].astype(np.int32))
    used, corner = np.unique(faces, return_inverse=True)
    return points[used], corner.reshape(-1, 3).astype(np.int32)


def _mean_colours(base: SegmentMesh, vertices: Float32, tree: cKDTree) -> UInt8 | None:
    """Mean colour of the base's samples that are nearest to each vertex; (V, 3) sRGB."""
    samples = _samples(base)
    if samples is None:
        return None
    places, colours, weights = samples
    nearest: Int64 = tree.query(places)[1]
    weight = np.bincount(nearest, weights, minlength=len(vertices))
    sums = [
        np.bincount(nearest, weights * colours[:, channel], minlength=len(vertices))
        for channel in range(3)
    ]
    means = np.stack(sums, axis=1) / np.maximum(weight, 1e-12)[:, None]
    # A vertex that is nearest to no sample has the colour of the sample nearest to it.
    bare = np.flatnonzero(weight == 0)
    means[bare] = colours[cKDTree(places).query(vertices[bare])[1]]
    return np.rint(means).astype(np.uint8)


_SPOTS: Final = ((4, 1, 1), (1, 4, 1), (1, 1, 4), (2, 2, 2))
"""Where on a face its colour is looked up: weights of its corners, sixths."""


def _samples(base: SegmentMesh) -> tuple[Float64, Float64, Float64] | None:
    """Places on the base, (N, 3) metres, their colours, (N, 3), and the area of each."""
    if base.texture is None and base.colours is None:
        return None
    a, b, c = (base.positions[base.faces[:, corner]].astype(np.float64) for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2 + 1e-9
    spots = np.array(_SPOTS) / 6
    places = np.concatenate([w[0] * a + w[1] * b + w[2] * c for w in spots])
    if base.texture is not None and base.uvs is not None:
        pixels = decode_image(base.texture.data)
        size = np.array([pixels.shape[1], pixels.shape[0]])
        corners = base.uvs[base.faces].astype(np.float64)
        uvs = np.concatenate([np.tensordot(corners, w, axes=(1, 0)) for w in spots])
        column, row = np.clip((uvs * size).astype(np.int64), 0, size - 1).T
        colours = pixels[row, column].astype(np.float64)
    else:
        assert base.colours is not None
        of_corners = base.colours[base.faces].astype(np.float64)
        colours = np.concatenate([np.tensordot(of_corners, w, axes=(1, 0)) for w in spots])
    return places, colours, np.tile(area, len(spots))
