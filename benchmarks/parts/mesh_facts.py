"""Facts of the regions of one mesh in memory, as those of a scene with a single tile."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from terraport_payload.types import AnyFloat, Int32, UInt8
from terraport_pipeline.geometry.mesh.face_measures import surface_area
from terraport_pipeline.geometry.regions.region_roughness import automatic_roughness_scale
from terraport_pipeline.geometry.regions.region_totals import (
    slope_bins,
    tile_totals,
    totals_document,
)

__all__ = ["region_facts"]


def region_facts(
    vertices: AnyFloat,
    faces: Int32,
    colours: UInt8,
    regions: Int32,
    pairs: tuple[Int32, Int32],
    attributes: Mapping[str, AnyFloat] | None = None,
) -> dict[str, Any]:
    """Sum up a mesh's regions and write the sums down."""
    attributes = attributes or {}
    extent_m = float(np.ptp(vertices, axis=0).max())
    scale_m = automatic_roughness_scale(surface_area(vertices, faces), len(faces), extent_m)
    count = int(regions.max()) + 1
    totals = tile_totals(
        vertices, faces, colours, regions, count,
        attributes=attributes, pairs=pairs, roughness_scale_m=scale_m, bins=slope_bins(count),
    )  # fmt: skip
    return totals_document(totals, list(attributes), scale_m)
