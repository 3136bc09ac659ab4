"""A mesh as content of a tile: GLB whose regions and attributes other viewers understand.

``EXT_mesh_features`` numbers the regions from 0, and ``EXT_structural_metadata`` says what they are
(a property table) and what the attributes' codes mean (property attributes): 3D Metadata 1.0.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from terraport_payload import AttributeScale, SegmentMesh
from terraport_payload.glb_container import join_glb
from terraport_payload.glb_encode import glb_parts
from terraport_payload.grid import NULL_CODE
from terraport_payload.types import AnyArray, Int64
from terraport_store.manifest import Manifest

__all__ = ["TileFacts", "encode_tile"]

_EXTENSION: Final = "EXT_structural_metadata"

_FACTS: Final = (
    ("area_m2", "Area of its surface, square metres"),
    ("plan_area_m2", "Area seen from above, square metres"),
)
"""Facts of regions.json that viewers are told, where each region has them."""


@dataclass(frozen=True, slots=True, eq=False)
class TileFacts:
    """What tiles say of a scene's regions and attributes."""

    step_m: float
    scales: Mapping[str, AttributeScale]
    properties: Mapping[str, str]
    """Property of 3D Metadata by the survey's name of an attribute."""
    regions: Mapping[str, AnyArray | list[str]]
    """Columns over all regions of the scene, by property."""
    schema: Mapping[str, Any]

    @classmethod
    def of(
        cls,
        manifest: Manifest,
        regions: Sequence[Mapping[str, Any]],
        labels: Sequence[str] | None = None,
    ) -> TileFacts:
        """Take them from a scene.

        Parameters
        ----------
        manifest : Manifest
        regions : sequence of mapping
            Those of ``regions.json``; rows that are not as expected tell less.
        labels : sequence of str, optional
            What people call each region, "" for nothing.
        """
        rows = [row if isinstance(row, Mapping) else {} for row in regions]
        columns: dict[str, AnyArray | list[str]] = {
            "region": np.arange(len(rows), dtype="<u2"),
        }
        described = {
            "region": {"type": "SCALAR", "componentType": "UINT16", "required": True},
        }
        numbers = [row.get("stable_id") for row in rows]
        if all(type(number) is int and 0 <= number < 1 << 32 for number in numbers):
            columns["stable_id"] = np.array(numbers, dtype="<u4")
            described["stable_id"] = {
                "description": "The same in every version of the scene",
                "type": "SCALAR",
                "componentType": "UINT32",
                "required": True,
            }
        for name, description in _FACTS:
            values = [row.get(name) for row in rows]
            if all(type(value) in (int, float) for value in values):
                columns[name] = np.array(values, dtype="<f4")
                described[name] = {
                    "description": description,
                    "type": "SCALAR",
                    "componentType": "FLOAT32",
                    "required": True,
                }
        if labels is not None:
            columns["label"] = list(labels)
            # A table of regions without a name has no such column: see `_column`.
            described["label"] = {"type": "STRING"}
        classes: dict[str, Any] = {"region": {"properties": described}}
        properties: dict[str, str] = {}
        attributes: dict[str, Any] = {}
        for info in manifest.attributes:
            name = re.sub(r"\W", "_", info.gltf_name.strip("_").lower(), flags=re.ASCII)
            name = name if name[:1].isalpha() else f"attribute_{name}"
            properties[info.name] = name
            attributes[name] = {
                "name": info.name,
                "type": "SCALAR",
                "componentType": "UINT16",
                # Only normalised integers may be scaled: the code times 1 / 65535.
                "normalized": True,
                "offset": info.offset,
                "scale": info.step * 65535,
                "noData": NULL_CODE,
            }
        if attributes:
            classes["vertex"] = {"properties": attributes}
        return cls(
            manifest.step_m,
            manifest.scales,
            properties,
            columns if rows else {},
            {"id": "terraport", "classes": classes},
        )


def encode_tile(mesh: SegmentMesh, facts: TileFacts) -> bytes:
    """Encode a mesh as content of a tile.

    Parameters
    ----------
    mesh : SegmentMesh
        Scene frame, metres.
    facts : TileFacts

    Returns
    -------
    bytes
        One GLB, compressed: positions on the scene's grid, bit by bit those
        of the scene. Same input, same bytes.
    """
    here: Int64 | None = None
    if mesh.region_ids is not None:
        here, local = np.unique(mesh.region_ids, return_inverse=True)
        mesh = replace(mesh, region_ids=local.reshape(-1).astype(np.uint16))
    # Unlit: a survey's colours contain its light, and become dark if lit again. All content of a
    # tileset must agree, else full detail and base differ in brightness.
    document, encoded = glb_parts(
        mesh, step_m=facts.step_m, attribute_scales=facts.scales, unlit=True
    )
    binary = bytearray(encoded)
    primitive = document["meshes"][0]["primitives"][0]
    used: dict[str, Any] = {}
    # (1) The regions that the mesh has, by the numbers that its vertices now have.
    known = len(facts.regions.get("region", ()))
    if here is not None and known and int(here[-1]) < known:
        primitive["extensions"]["EXT_mesh_features"]["featureIds"][0]["propertyTable"] = 0
        properties = {
            name: values
            for name, column in facts.regions.items()
            if (values := _column(document, binary, column, here)) is not None
        }
        used["propertyTables"] = [
            {"name": "regions", "class": "region", "count": len(here), "properties": properties}
        ]
    # (2) What the codes of attributes mean.
    if mesh.attributes:
        table = document["meshes"][0]["extras"]["terraport"]["attributes"]
        for row in table:
            accessor = primitive["attributes"][row["gltf_name"]]
            document["accessors"][accessor]["normalized"] = True
        used["propertyAttributes"] = [
            {
                "class": "vertex",
                "properties": {
                    facts.properties[row["name"]]: {"attribute": row["gltf_name"]} for row in table
                },
            }
        ]
        primitive.setdefault("extensions", {})[_EXTENSION] = {"propertyAttributes": [0]}
    if used:
        document["extensionsUsed"].append(_EXTENSION)
        document["extensions"] = {_EXTENSION: {"schema": facts.schema, **used}}
    # (3) Other tools need none of ours, and codes that are said to be normalised are not ours.
    del document["meshes"][0]["extras"]
    document["buffers"][0]["byteLength"] = len(binary)
    return join_glb(document, bytes(binary))


def _column(
    document: dict[str, Any], binary: bytearray, column: AnyArray | list[str], rows: Int64
) -> dict[str, Any] | None:
    """Append a column of a property table; return what names it, None for texts without a letter.

    A bufferView has a byte at least, and 3D Metadata wants the texts' to end with the last offset,
    which is 0 there.
    """
    if isinstance(column, np.ndarray):
        return {"values": _view(document, binary, column[rows].tobytes())}
    texts = [column[row].encode() for row in rows.tolist()]
    offsets = np.cumsum([0, *(len(text) for text in texts)]).astype("<u4")
    if not any(texts):
        return None
    values = _view(document, binary, b"".join(texts))
    return {"values": values, "stringOffsets": _view(document, binary, offsets.tobytes())}


def _view(document: dict[str, Any], binary: bytearray, data: bytes) -> int:
    binary += bytes(-len(binary) % 8)
    document["bufferViews"].append(
        {"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)}
    )
    binary += data
    binary += bytes(-len(data) % 4)
    return len(document["bufferViews"]) - 1
