"""The tile of a scene from a mesh: the mesh itself, in the scene's frame and in an order.

Nothing is reconstructed and no surface is left out but faces without area and repeated ones. Faces
follow a Morton curve: neighbours in space are neighbours in memory, whatever order the program
wrote them in. Memory: about 200 bytes a face.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, Bool, Float32, Float64, Int32
from terraport_pipeline.geometry.cover.hem import add_hem
from terraport_pipeline.geometry.mesh.border_edges import open_edges
from terraport_pipeline.geometry.mesh.curve import morton_order
from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals
from terraport_pipeline.model import to_scene
from terraport_pipeline.stages.contract import Stored
from terraport_pipeline.stages.tiles.detail_tiles import vertex_box
from terraport_pipeline.stages.tiles.tile_edges import HEM_SPACINGS

__all__ = ["BYTES_PER_FACE", "run"]

BYTES_PER_FACE: Final = 200
_GREY: Final = 128


def run(arrays: Mapping[str, AnyArray], attributes: int) -> Stored:
    """Make the tile.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        What :mod:`~terraport_pipeline.stages.read_mesh` wrote, by name.
    attributes : int
        How many there are.

    Returns
    -------
    Stored
        Arrays of :class:`.StoredTiles`, without a border; of a textured mesh also ``pixels`` and
        ``image`` of every face. Values: ``origin``, ``box``, ``spacing_m`` (median edge), ``faces``
        and so on.
    """
    # (1) The scene's frame, and what has an area there.
    positions: Float64 = np.asarray(arrays["vertices"])
    faces: Int32 = np.asarray(arrays["faces"])
    used = np.zeros(len(positions), np.bool_)
    used[faces.ravel()] = True
    origin = _origin(positions[used])
    vertices = to_scene(positions, origin) + np.float32(0.0)
    solid = _with_area(vertices, faces)
    first = _first_of_each(faces)
    kept = np.flatnonzero(solid & first)
    # (2) An order by place: of faces, and of vertices by first use.
    centres = vertices[faces[kept]].mean(axis=1)
    kept = kept[morton_order(centres)]
    flat = faces[kept].ravel()
    _, at, number = np.unique(flat, return_index=True, return_inverse=True)
    rank = np.empty(len(at), np.int32)
    order = np.argsort(at, kind="stable")
    rank[order] = np.arange(len(at), dtype=np.int32)
    triangles = rank[number.reshape(-1)].reshape(-1, 3)
    rows = flat[at[order]]
    points = np.ascontiguousarray(vertices[rows])
    # (3) What is asked about it later.
    spacing_m = _median_edge_m(points, triangles)
    wide, wide_faces = add_hem(points, triangles, width_m=HEM_SPACINGS * spacing_m)
    colours = np.full((len(rows), 3), _GREY, np.uint8)
    if "colours" in arrays:
        colours = np.asarray(arrays["colours"], np.uint8)[rows]
    result: dict[str, Any] = {
        "vertices": points,
        "faces": triangles,
        "normals": vertex_normals(points, triangles),
        "colours": colours,
        "border-rows": np.zeros(0, np.int32),
        "border-shared": np.zeros(0, np.int64),
        "base-vertices": wide,
        "base-faces": wide_faces,
    }
    for i in range(attributes):
        result[f"attribute-{i}"] = np.asarray(arrays[f"attribute-{i}"], np.float32)[rows]
    for name in ("pixels", "image"):
        if name in arrays:
            result[name] = np.asarray(arrays[name])[kept]
    values = {
        "origin": origin.tolist(),
        "box": vertex_box(points).tolist(),
        "spacing_m": spacing_m,
        "faces": len(triangles),
        "vertices": len(points),
        "base_faces": len(wide_faces),
        "faces_without_area": int((~solid).sum()),
        "faces_repeated": int((solid & ~first).sum()),
        "open_edges": len(open_edges(triangles, len(points))),
        "facing_down_share": round(_facing_down(points, triangles), 4),
    }
    return Stored(result, values)


def _origin(positions: Float64) -> Float64:
    """Middle of the box in whole metres, at the floor of the lowest height: as of a survey."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    east, north = np.rint((low + high) / 2)[:2]
    return np.array([east, north, np.floor(low[2])])


def _with_area(vertices: Float32, faces: Int32) -> Bool:
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    has_area: Bool = np.any(np.cross(b - a, c - a) != 0.0, axis=1)
    return has_area


def _first_of_each(faces: Int32) -> Bool:
    """Mark the first of faces with the same three corners."""
    corners = np.ascontiguousarray(np.sort(faces, axis=1)).view("V12").reshape(-1)
    _, rows = np.unique(corners, return_index=True)
    first = np.zeros(len(faces), np.bool_)
    first[rows] = True
    return first


def _median_edge_m(vertices: Float32, faces: Int32) -> float:
    a, b = vertices[faces[:, 0]].astype(np.float64), vertices[faces[:, 1]]
    return float(np.median(np.linalg.norm(b - a, axis=1)))


def _facing_down(vertices: Float32, faces: Int32) -> float:
    """Share of the plan's area that faces of the ground turn their backs up with."""
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    upward = np.cross(b - a, c - a)[:, 1]
    return float(-upward[upward < 0].sum() / max(float(np.abs(upward).sum()), 1e-300))
