"""Meshes as Wavefront OBJ, with material and image: what most modelling programs open."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Final

import numpy as np

from terraport.errors import UsageError
from terraport_payload import SegmentMesh

__all__ = ["write_obj"]

_SUFFIXES: Final = {
    "image/jpeg": ".jpg",
    "image/png": ".png",
    "image/webp": ".webp",
    "image/ktx2": ".ktx2",
}


def write_obj(mesh: SegmentMesh, path: str | Path) -> int:
    """Write a mesh as OBJ; a texture goes beside it as it is, with an MTL file that names it.

    Parameters
    ----------
    mesh : SegmentMesh
        Vertex colours stand behind the positions, as MeshLab, Blender and CloudCompare read them.
        Region ids and attributes have no place in an OBJ and are left out.
    path : Path
        Ends in ``.obj``. The three files are replaced one by one.

    Returns
    -------
    int
        Bytes written, over all files.

    Raises
    ------
    UsageError
        The path ends otherwise, or the mesh has no face.
    OSError
        A file cannot be written.
    """
    target = Path(path)
    if target.suffix.lower() != ".obj":
        raise UsageError(f"path ends in {target.suffix!r}, expected .obj")
    if len(mesh.faces) == 0:
        raise UsageError("a mesh of 0 faces, expected at least one")
    text = io.StringIO()
    written = 0
    if mesh.texture is not None:
        image = target.with_suffix(_SUFFIXES[mesh.texture.media_type])
        image.write_bytes(mesh.texture.data)
        material = f"newmtl surface\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {image.name}\n".encode()
        target.with_suffix(".mtl").write_bytes(material)
        written = len(mesh.texture.data) + len(material)
        text.write(f"mtllib {target.with_suffix('.mtl').name}\nusemtl surface\n")
    if mesh.colours is None:
        np.savetxt(text, mesh.positions, "v %.9g %.9g %.9g")
    else:
        rows = np.hstack([mesh.positions, mesh.colours / 255.0])
        np.savetxt(text, rows, "v %.9g %.9g %.9g %.4f %.4f %.4f")
    numbers = mesh.faces.astype(np.int64) + 1  # OBJ counts from 1
    if mesh.uvs is not None:
        # OBJ's v points up, glTF's down.
        np.savetxt(text, np.column_stack([mesh.uvs[:, 0], 1.0 - mesh.uvs[:, 1]]), "vt %.7f %.7f")
    np.savetxt(text, mesh.normals, "vn %.5f %.5f %.5f")
    corner = "%d//%d" if mesh.uvs is None else "%d/%d/%d"
    columns = np.repeat(numbers, 2 if mesh.uvs is None else 3, axis=1)
    np.savetxt(text, columns, f"f {corner} {corner} {corner}")
    data = text.getvalue().encode("ascii")
    target.write_bytes(data)
    return written + len(data)
