"""A segmentation as a file: numbers, or the mesh with every segment in a colour of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.colour import srgb_to_linear16
from terraport_payload.glb_container import join_glb
from terraport_payload.types import Float64, Int32
from terraport_pipeline.engines.mesh_files.endings import SEGMENT_ENDINGS
from terraport_pipeline.engines.palettes import distinct_colours
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.mesh.uv import split_wedges

__all__ = ["check_ending", "write_segments"]


_EXACT: Final = 1 << 14
"""Coordinates up to this keep a thousandth in 32 bits; a PLY with larger ones has 64."""


def write_segments(path: Path, labels: Int32, vertices: Float64, faces: Int32) -> None:
    """Write labels in the format of the path's ending; whole, or not at all.

    Parameters
    ----------
    path : Path
        ``.seg``: a number a line, in the order of the faces, as Princeton's benchmark has them.
        ``.npy``: the same as an array (F,), int32. ``.ply``, ``.glb``: the mesh in colours, the
        number of each face's segment beside it (``segment``; ``_SEGMENT`` of a GLB's vertices).
    labels : ndarray of shape (F,), int32
        Segment of every face, from 0.
    vertices : ndarray of shape (V, 3), float64
    faces : ndarray of shape (F, 3), int32

    Raises
    ------
    OptionError
        Another ending.
    """
    kind = path.suffix.lower()
    check_ending(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.part")
    try:
        if kind == ".seg":
            part.write_text("\n".join(map(str, labels.tolist())) + "\n", encoding="ascii")
        elif kind == ".npy":
            with part.open("wb") as file:
                np.save(file, labels.astype(np.int32))
        else:
            write = _ply if kind == ".ply" else _glb
            part.write_bytes(write(labels, vertices, faces))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def check_ending(path: Path) -> None:
    """Refuse what no format is known for.

    Raises
    ------
    OptionError
        Says which there are.
    """
    if path.suffix.lower() not in SEGMENT_ENDINGS:
        raise OptionError(
            f"output {path} ends in {path.suffix or 'nothing'}; expected "
            f"{', '.join(SEGMENT_ENDINGS[:-1])} or {SEGMENT_ENDINGS[-1]}"
        )


def _ply(labels: Int32, vertices: Float64, faces: Int32) -> bytes:
    split = split_wedges(faces, np.zeros((*faces.shape, 2)), len(vertices), labels=labels)
    real, word = ("<f8", "double") if np.abs(vertices).max() > _EXACT else ("<f4", "float")
    rows = np.empty(
        len(split.vertex),
        [(axis, real) for axis in "xyz"] + [(c, "u1") for c in ("red", "green", "blue")],
    )
    colours = distinct_colours(int(labels.max()) + 1)[split.labels]
    for axis, name in enumerate("xyz"):
        rows[name] = vertices[split.vertex, axis]
    for channel, name in enumerate(("red", "green", "blue")):
        rows[name] = colours[:, channel]
    triangles = np.empty(len(faces), [("n", "u1"), ("corners", "<i4", 3), ("segment", "<i4")])
    triangles["n"], triangles["corners"], triangles["segment"] = 3, split.faces, labels
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment terraport segment",
        f"element vertex {len(rows)}",
        *(f"property {word} {axis}" for axis in "xyz"),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        f"element face {len(triangles)}",
        "property list uchar int vertex_indices",
        "property int segment",
        "end_header",
    ]
    return ("\n".join(header) + "\n").encode("ascii") + rows.tobytes() + triangles.tobytes()


def _glb(labels: Int32, vertices: Float64, faces: Int32) -> bytes:
    split = split_wedges(faces, np.zeros((*faces.shape, 2)), len(vertices), labels=labels)
    # Positions have 32 bits: around the middle, which the node puts back.
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    positions = (vertices[split.vertex] - middle).astype("<f4")
    colours = np.zeros((len(positions), 4), "<u2")
    colours[:, :3] = srgb_to_linear16(distinct_colours(int(labels.max()) + 1)[split.labels])
    colours[:, 3] = 65535
    arrays = [
        (positions, 5126, "VEC3", 34962),
        (colours, 5123, "VEC4", 34962),
        (split.labels.astype("<f4"), 5126, "SCALAR", 34962),
        (split.faces.astype("<u4").reshape(-1), 5125, "SCALAR", 34963),
    ]
    views, accessors, offset = [], [], 0
    for array, component, kind, target in arrays:
        views.append(
            {"buffer": 0, "byteOffset": offset, "byteLength": array.nbytes, "target": target}
        )
        accessors.append(
            {
                "bufferView": len(views) - 1,
                "componentType": component,
                "count": len(array),
                "type": kind,
            }
        )
        offset += array.nbytes
    accessors[0] |= {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
    accessors[1]["normalized"] = True
    document = {
        "asset": {"version": "2.0", "generator": "terraport segment"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": middle.tolist()}],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": {"POSITION": 0, "COLOR_0": 1, "_SEGMENT": 2},
                        "indices": 3,
                        "material": 0,
                    }
                ]
            }
        ],
        "materials": [
            {
                "doubleSided": True,
                "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 1},
            }
        ],
        "buffers": [{"byteLength": offset}],
        "bufferViews": views,
        "accessors": accessors,
    }
    return join_glb(document, b"".join(array.tobytes() for array, *_ in arrays))
