"""What is told of many atlases together: densities, areas, charts."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from terraport_pipeline.model import Float32
from terraport_pipeline.stages.atlas_maker import MadeAtlas

__all__ = ["TextureSums"]


class TextureSums:
    """Sums over the faces of a mesh, piece by piece."""

    def __init__(self, faces: int) -> None:
        self.surface_m2 = np.empty(faces, np.float32)
        self.texel_m = np.empty(faces, np.float32)
        self.gsd_m = np.empty(faces, np.float32)
        self.charts = 0
        self.used = 0.0

    def add(self, faces: npt.NDArray[np.integer], made: MadeAtlas) -> None:
        """Add one piece's faces."""
        self.surface_m2[faces] = made.surface_m2
        self.texel_m[faces] = np.sqrt(made.surface_m2 / np.maximum(made.texels, 1e-12))
        self.gsd_m[faces] = made.gsd_m
        self.charts += made.charts
        self.used += made.use * made.width * made.height

    def facts(self, sides: npt.NDArray[np.integer], image_bytes: int) -> dict[str, Any]:
        """Tell of all; *sides* is (S, 2)."""
        seen = ~np.isnan(self.gsd_m)
        area = float(self.surface_m2.sum(dtype=np.float64))
        unseen = float(self.surface_m2[~seen].sum(dtype=np.float64))
        texels = int((sides[:, 0].astype(np.int64) * sides[:, 1]).sum())
        gsd_m = _median(self.gsd_m[seen], self.surface_m2[seen]) if seen.any() else None
        return {
            "images": len(sides),
            "image_bytes": image_bytes,
            "texels": texels,
            "longest_side": int(sides.max()),
            "charts": self.charts,
            "cells_share": round(self.used / texels, 3),
            "texel_m": _median(self.texel_m, self.surface_m2),
            "gsd_m": gsd_m,
            "unseen_share": round(unseen / area, 4) if area > 0 else 0.0,
        }


def _median(values: Float32, weights: Float32) -> float:
    """Median by weight, to four digits."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order], dtype=np.float64)
    place = int(np.searchsorted(total, 0.5 * total[-1]))
    return float(f"{values[order[min(place, len(order) - 1)]]:.4g}")
