"""Whether the arrays of a :class:`SegmentMesh` belong together. PURE: no I/O, no clock."""

from __future__ import annotations

import numpy as np

from terraport_payload.errors import PayloadError
from terraport_payload.mesh import SegmentMesh
from terraport_payload.types import AnyArray

__all__ = ["check_mesh"]


def check_mesh(mesh: SegmentMesh) -> None:
    """Check shapes, dtypes, index range and finiteness.

    Parameters
    ----------
    mesh : SegmentMesh
        Never modified.

    Raises
    ------
    PayloadError
        Naming the first array that is wrong, what it is and what was expected. A mesh without a
        face is wrong: a segment or base without geometry has no payload.
    """
    vertices = len(mesh.positions)
    _expect("positions", mesh.positions, np.float32, (vertices, 3))
    _expect("normals", mesh.normals, np.float32, (vertices, 3))
    _expect("faces", mesh.faces, np.uint32, (len(mesh.faces), 3))
    if mesh.colours is not None:
        _expect("colours", mesh.colours, np.uint8, (vertices, 3))
    if mesh.region_ids is not None:
        _expect("region_ids", mesh.region_ids, np.uint16, (vertices,))
    for name, values in mesh.attributes.items():
        _expect(f"attribute {name!r}", values, np.float32, (vertices,))
    if (mesh.uvs is None) != (mesh.texture is None):
        have, lack = ("uvs", "texture") if mesh.texture is None else ("texture", "uvs")
        raise PayloadError(f"a mesh with {have} and without {lack}, expected both or neither")
    if mesh.uvs is not None:
        _expect("uvs", mesh.uvs, np.float32, (vertices, 2))
        if mesh.colours is not None:
            raise PayloadError(
                "a mesh with texture and vertex colours, expected one of them (glTF multiplies)"
            )
    if vertices == 0 or len(mesh.faces) == 0:
        raise PayloadError(
            f"{vertices} vertices and {len(mesh.faces)} faces, expected at least one face"
        )
    last = int(mesh.faces.max())
    if last >= vertices:
        raise PayloadError(f"a face uses vertex {last}, expected below {vertices}")
    for name, values in (("positions", mesh.positions), ("normals", mesh.normals)):
        if not bool(np.isfinite(values).all()):
            row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
            raise PayloadError(
                f"{name} of vertex {row} are {values[row].tolist()}, expected finite numbers"
            )
    if mesh.uvs is not None:
        inside = ((mesh.uvs >= 0) & (mesh.uvs <= 1)).all(axis=1)  # NaN fails both
        if not bool(inside.all()):
            row = int(np.flatnonzero(~inside)[0])
            raise PayloadError(f"uvs of vertex {row} are {mesh.uvs[row].tolist()}, expected 0 to 1")


def _expect(name: str, values: AnyArray, dtype: type[np.generic], shape: tuple[int, ...]) -> None:
    if values.dtype != np.dtype(dtype) or values.shape != shape:
        raise PayloadError(
            f"{name} is {values.dtype} {values.shape}, expected {np.dtype(dtype)} {shape}"
        )
