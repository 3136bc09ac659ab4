"""The ``arrays`` payload: flat little-endian arrays, what a procedural-mesh API takes.

A :mod:`~terraport_payload.flatfile` with magic ``TPARRAYS``, its row count the number of vertices
V, and the fields

=================  ========  ======  ====================================================
name               dtype     rows    meaning
=================  ========  ======  ====================================================
positions          f4 x 3    V       metres, scene frame
normals            f4 x 3    V       unit
indices            u4 x 3    F       counter-clockwise seen from outside
colours            u1 x 4    V       sRGB and alpha 255; absent without colour
region_ids         u2        V       absent without regions
attribute/<name>   f4        V       the survey's attribute, NaN for none
uvs                f4 x 2    V       0..1, from the image's upper left; absent without texture
texture            u1        bytes   the image file; absent without texture
=================  ========  ======  ====================================================

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Any, Final, cast

import numpy as np
import numpy.typing as npt

from terraport_payload.errors import PayloadError
from terraport_payload.flatfile import decode_flat, encode_flat
from terraport_payload.mesh import SegmentMesh
from terraport_payload.meshcheck import check_mesh
from terraport_payload.texture import Texture

__all__ = ["ARRAYS_MAGIC", "decode_arrays", "encode_arrays"]

ARRAYS_MAGIC: Final = b"TPARRAYS"
"""First eight bytes of every arrays payload."""

_ATTRIBUTE: Final = "attribute/"


def encode_arrays(mesh: SegmentMesh) -> bytes:
    """Encode a mesh as flat arrays, bit for bit as given.

    Parameters
    ----------
    mesh : SegmentMesh
        Scene frame, metres. Give ``decode_glb(glb)`` to make both encodings of a segment equal to
        the bit.

    Returns
    -------
    bytes
        About 26 bytes per triangle without attributes. Same input, same bytes.

    Raises
    ------
    PayloadError
        When the arrays do not belong together, or an attribute's name is longer than 62 bytes of
        UTF-8.
    """
    check_mesh(mesh)
    fields: dict[str, npt.NDArray[Any]] = {
        "positions": mesh.positions,
        "normals": mesh.normals,
        "indices": mesh.faces,
    }
    if mesh.colours is not None:
        opaque = np.full((len(mesh.colours), 4), 255, dtype=np.uint8)
        opaque[:, :3] = mesh.colours  # four bytes: the size engines want a vertex colour in
        fields["colours"] = opaque
    if mesh.region_ids is not None:
        fields["region_ids"] = mesh.region_ids
    for name, values in mesh.attributes.items():
        fields[_ATTRIBUTE + name] = values
    if mesh.uvs is not None and mesh.texture is not None:
        fields["uvs"] = mesh.uvs
        fields["texture"] = np.frombuffer(mesh.texture.data, dtype=np.uint8)
    return encode_flat(ARRAYS_MAGIC, len(mesh.positions), fields)


def decode_arrays(data: bytes | memoryview) -> SegmentMesh:
    """Decode an arrays payload; safe on hostile bytes.

    Parameters
    ----------
    data : bytes or memoryview
        The whole payload.

    Returns
    -------
    SegmentMesh
        Read-only views of *data*; nothing is copied but the colours and the image's bytes.

    Raises
    ------
    PayloadError
        With the offset where one is known, for anything that is not a whole, consistent arrays
        payload.
    """
    rows, fields = decode_flat(data, ARRAYS_MAGIC)
    colours = _field(fields, "colours", "<u1", rows, 4, required=False)
    image = _field(fields, "texture", "<u1", None, 1, required=False)
    mesh = SegmentMesh(
        positions=cast("npt.NDArray[np.float32]", _field(fields, "positions", "<f4", rows, 3)),
        faces=cast("npt.NDArray[np.uint32]", _field(fields, "indices", "<u4", None, 3)),
        normals=cast("npt.NDArray[np.float32]", _field(fields, "normals", "<f4", rows, 3)),
        colours=None if colours is None else np.ascontiguousarray(colours[:, :3]),
        region_ids=_field(fields, "region_ids", "<u2", rows, 1, required=False),
        attributes={
            name.removeprefix(_ATTRIBUTE): cast(
                "npt.NDArray[np.float32]", _field(fields, name, "<f4", rows, 1)
            )
            for name in fields
            if name.startswith(_ATTRIBUTE)
        },
        uvs=_field(fields, "uvs", "<f4", rows, 2, required=False),
        texture=None if image is None else Texture.of(image.tobytes()),
    )
    check_mesh(mesh)
    return mesh


def _field(
    fields: dict[str, npt.NDArray[np.generic]],
    name: str,
    dtype: str,
    rows: int | None,
    components: int,
    *,
    required: bool = True,
) -> npt.NDArray[Any] | None:
    """Take one field, checked for type and shape; None where it is absent and may be."""
    values = fields.get(name)
    if values is None:
        if required:
            raise PayloadError(f"no field {name!r}")
        return None
    tail = () if components == 1 else (components,)
    expected = (len(values) if rows is None else rows, *tail)
    if values.dtype != np.dtype(dtype) or values.shape != expected:
        raise PayloadError(
            f"field {name!r} is {values.dtype} {values.shape}, "
            f"expected {np.dtype(dtype)} {expected}"
        )
    return values
