"""What a mesh file holds, before it is built: surface, textures, and what states where it is."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import PIL.Image

from terraport_pipeline.engines.mesh_files.read_mesh import FileImage, FileMesh, read_mesh
from terraport_pipeline.errors import ReadError
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.mesh.border_edges import open_edges
from terraport_pipeline.stages.read_mesh import place_mesh
from terraport_pipeline.survey.find_mesh import MeshInput

__all__ = ["inspect_mesh"]


def inspect_mesh(given: MeshInput) -> dict[str, Any]:
    """Gather the facts of a mesh.

    Parameters
    ----------
    given : MeshInput

    Returns
    -------
    dict
        Plain values: ``file``, ``faces``, ``vertices``, ``parts``, ``polygons`` that were cut,
        ``pieces``, ``open_edges``, ``colours``, ``attributes``; ``textures`` (None without):
        ``images`` (name, width, height), ``faces_without``, ``texel`` (length in the file's unit);
        ``place``: ``up``, ``shift`` and who states it, ``crs``, ``size_m``, ``low``, ``high``;
        ``refused`` (None, or why a build would refuse it) and ``warnings``.

    Raises
    ------
    ReadError
        The file cannot be read.
    """
    mesh = read_mesh(given.path)
    pairs, _ = face_pairs(mesh.faces, len(mesh.vertices))
    _, pieces = components(len(mesh.faces), pairs)
    facts: dict[str, Any] = {
        "file": given.path.name,
        "bytes": given.path.stat().st_size,
        "faces": len(mesh.faces),
        "vertices": len(mesh.vertices),
        "parts": 1,
        "materials": 0,
        "polygons": 0,
        **mesh.facts,
        "pieces": pieces,
        "open_edges": len(open_edges(mesh.faces, len(mesh.vertices))),
        "median_edge": _median_edge(mesh),
        "colours": mesh.origin_of_colours,
        "attributes": sorted(mesh.attributes),
        "textures": _textures(mesh),
        "files": [file.name for file in given.files[1:]],
    }
    missing = None if mesh.missing is None else str(mesh.missing)
    try:
        placed = place_mesh(given, mesh)
    except ReadError as error:
        return {**facts, "place": None, "refused": str(error), "warnings": [*mesh.warnings]}
    low, high = placed.positions.min(axis=0), placed.positions.max(axis=0)
    facts["place"] = {
        "up": given.up,
        "shift": list(given.mesh.shift or given.place.shift or (0.0, 0.0, 0.0)),
        "shift_from": "--shift" if given.mesh.shift else given.place.shift_from or None,
        "crs": None if placed.crs is None else placed.crs.name,
        "low": low.tolist(),
        "high": high.tolist(),
        "size_m": (high - low).tolist(),
    }
    return {**facts, "refused": missing, "warnings": [*mesh.warnings, *placed.warnings]}


def _median_edge(mesh: FileMesh) -> float:
    ends = mesh.vertices[mesh.faces[:, :2]]
    return float(np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))


def _textures(mesh: FileMesh) -> dict[str, Any] | None:
    texture = mesh.texture
    if texture is None:
        return None
    images = [_size(image) for image in texture.images]
    seen = texture.image >= 0
    side = np.array([(image["width"], image["height"]) for image in images], np.float64)
    wedges = texture.wedges[seen] * side[texture.image[seen]][:, None, :]
    a, b = wedges[:, 1] - wedges[:, 0], wedges[:, 2] - wedges[:, 0]
    texels = float(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    corners = mesh.vertices[mesh.faces[seen]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = float(np.linalg.norm(normal, axis=1).sum())
    return {
        "images": images,
        "faces_without": int((~seen).sum()),
        "texel": float(np.sqrt(area / texels)) if texels > 0 else None,
    }


def _size(image: FileImage) -> dict[str, Any]:
    with PIL.Image.open(io.BytesIO(image.data())) as opened:
        return {"name": image.name, "width": opened.width, "height": opened.height}
