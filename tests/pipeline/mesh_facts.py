"""Facts of one mesh: normals and areas of its faces, its regions as those of a single tile."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float64, Int32, UInt8
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.regions.region_totals import (
    slope_bins,
    tile_totals,
    totals_document,
)


def face_normals(vertices: AnyFloat, faces: AnyInt) -> tuple[Float64, Float64]:
    """Unit normals, zero for faces without area, and areas."""
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    doubled = np.cross(b - a, c - a)
    length = np.linalg.norm(doubled, axis=1)
    normals: Float64 = doubled / np.maximum(length, np.finfo(np.float64).tiny)[:, None]
    return normals, 0.5 * length


def region_facts(
    vertices: AnyFloat,
    faces: AnyInt,
    colours: UInt8,
    regions: Int32,
    *,
    attributes: Mapping[str, AnyFloat] | None = None,
    roughness_scale_m: float = 1.0,
) -> dict[str, Any]:
    attributes = attributes or {}
    count = int(regions.max()) + 1
    totals = tile_totals(
        vertices, faces, colours, regions, count,
        attributes=attributes, pairs=face_pairs(faces, len(vertices)),
        roughness_scale_m=roughness_scale_m, bins=slope_bins(count),
    )  # fmt: skip
    return totals_document(totals, list(attributes), roughness_scale_m)
