"""What is told of many atlases together: densities, areas, charts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, AnyInt, Float32, Float64, Int64
from terraport_pipeline.stages.atlas_maker import BakedAtlas

__all__ = ["PHOTO_SHARES", "TextureSums", "TextureTally"]

PHOTO_SHARES: Final = "photo_ground_shares"
"""Note of the textures' report: [name, share of the surface] of every photo."""

_PER_DECADE: Final = 400
"""Bins of lengths per factor of ten: medians are good to 0.3 %."""

_MOST_CHART_FACES: Final = 4096
"""Larger charts count as this; no median lies there."""

_SHORTEST_M: Final = 1e-5
_BINS: Final = 9 * _PER_DECADE
"""From a hundredth of a millimetre to ten kilometres."""


@dataclass(frozen=True, slots=True, eq=False)
class TextureTally:
    """Sums over the faces of a piece of a mesh that add up to those of the whole."""

    texel_m2: Float64
    """(_BINS,) surface by the length of its texels, square metres."""
    gsd_m2: Float64
    """(_BINS,) surface that a photo shows, by the length of the photo's pixels."""
    surface_m2: float
    crowded_m2: float
    """Surface of flat colours, for want of room."""
    charts_by_faces: Int64
    """(_MOST_CHART_FACES + 1,) charts by the number of their faces."""
    photo_m2: Float64
    """(photos,) surface that each photo colours; where two are blended, the first one's."""

    def arrays(self) -> dict[str, AnyArray]:
        """Convert to named arrays, as a work directory stores them."""
        return {
            "tally_texel": self.texel_m2,
            "tally_gsd": self.gsd_m2,
            "tally_surface": np.array([self.surface_m2, self.crowded_m2]),
            "tally_charts": self.charts_by_faces,
            "tally_photos": self.photo_m2,
        }

    @classmethod
    def total(cls, tallies: Iterable[Mapping[str, AnyArray]]) -> TextureTally:
        """Add up the stored tallies of several tiles."""
        texel, gsd, surface = np.zeros(_BINS), np.zeros(_BINS), np.zeros(2)
        charts, photos = np.zeros(_MOST_CHART_FACES + 1, np.int64), np.zeros(0)
        for tally in tallies:
            texel = texel + tally["tally_texel"]
            gsd = gsd + tally["tally_gsd"]
            surface = surface + tally["tally_surface"]
            charts = charts + tally["tally_charts"]
            photos = tally["tally_photos"] + (photos if len(photos) else 0.0)
        return cls(texel, gsd, float(surface[0]), float(surface[1]), charts, photos)

    def facts(self) -> dict[str, Any]:
        """Tell of them as :meth:`TextureSums.facts`."""
        unseen = max(0.0, self.surface_m2 - float(self.gsd_m2.sum()))
        return {
            "texel_m": _bin_median(self.texel_m2) if self.texel_m2.any() else None,
            "gsd_m": _bin_median(self.gsd_m2) if self.gsd_m2.any() else None,
            "unseen_share": _share(unseen, self.surface_m2),
            "crowded_share": _share(self.crowded_m2, self.surface_m2),
            **_chart_facts(self.charts_by_faces),
        }

    def photo_shares(self, names: Sequence[str]) -> list[list[str | float]]:
        """Say which share of the surface each photo colours, the largest first, unused ones too.

        Equal shares in the photos' own order.
        """
        order = np.argsort(-self.photo_m2, kind="stable")
        return [
            [names[row], round(float(self.photo_m2[row]) / max(self.surface_m2, 1e-300), 6)]
            for row in order
        ]


class TextureSums:
    """Sums over the faces of a mesh, piece by piece."""

    def __init__(self, faces: int, photos: int = 0) -> None:
        self.surface_m2 = np.empty(faces, np.float32)
        self.texel_m = np.empty(faces, np.float32)
        self.gsd_m = np.empty(faces, np.float32)
        self.flat = np.zeros(faces, np.bool_)
        self.crowded = np.zeros(faces, np.bool_)
        self.charts = 0
        self.charts_by_faces = np.zeros(_MOST_CHART_FACES + 1, np.int64)
        self.photo_m2 = np.zeros(photos)
        self.used = 0.0

    def add(self, faces: AnyInt, atlas: BakedAtlas) -> None:
        """Record area, texel size and sampling distance of one atlas's faces."""
        self.surface_m2[faces] = atlas.surface_m2
        self.texel_m[faces] = np.sqrt(atlas.surface_m2 / np.maximum(atlas.texels, 1e-12))
        self.gsd_m[faces] = atlas.gsd_m
        self.flat[faces] = atlas.flat
        self.crowded[faces] = atlas.crowded
        self.charts += atlas.charts
        sizes = np.minimum(atlas.chart_faces, _MOST_CHART_FACES)
        self.charts_by_faces += np.bincount(sizes, minlength=_MOST_CHART_FACES + 1)
        seen = atlas.view >= 0
        self.photo_m2 += np.bincount(
            atlas.view[seen], atlas.surface_m2[seen], minlength=len(self.photo_m2)
        )
        self.used += atlas.use * atlas.width * atlas.height

    def tally(self) -> TextureTally:
        """Convert to histograms, which those of other tiles can be added to."""
        seen = ~np.isnan(self.gsd_m)
        drawn = ~self.flat
        return TextureTally(
            _histogram(self.texel_m[drawn], self.surface_m2[drawn]),
            _histogram(self.gsd_m[seen], self.surface_m2[seen]),
            float(self.surface_m2.sum(dtype=np.float64)),
            float(self.surface_m2[self.crowded].sum(dtype=np.float64)),
            self.charts_by_faces,
            self.photo_m2,
        )

    def facts(self, sides: AnyInt, image_bytes: int) -> dict[str, Any]:
        """Summarise all atlases; *sides* is (S, 2), texels."""
        seen, drawn = ~np.isnan(self.gsd_m), ~self.flat
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
            "faces_per_chart": round(int(drawn.sum()) / max(self.charts, 1), 1),
            **_chart_facts(self.charts_by_faces),
            "cells_share": round(self.used / texels, 3),
            "texel_m": _median(self.texel_m[drawn], self.surface_m2[drawn]),
            "faces_without_area": int((self.surface_m2 == 0.0).sum()),
            "gsd_m": gsd_m,
            "unseen_share": _share(unseen, area),
            "crowded_share": _share(
                float(self.surface_m2[self.crowded].sum(dtype=np.float64)), area
            ),
        }


def _chart_facts(charts_by_faces: Int64) -> dict[str, Any]:
    """Median number of faces of a chart, the lower of two."""
    total = np.cumsum(charts_by_faces)
    if not total[-1]:
        return {}
    return {"faces_per_chart_p50": int(np.searchsorted(total, 0.5 * total[-1]))}


def _share(amount: float, whole: float) -> float:
    return round(amount / whole, 4) if whole > 0 else 0.0


def _median(values: Float32, weights: Float32) -> float:
    """Weighted median, to four significant digits."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order], dtype=np.float64)
    index = int(np.searchsorted(total, 0.5 * total[-1]))
    return float(f"{values[order[min(index, len(order) - 1)]]:.4g}")


def _histogram(lengths_m: Float32, areas_m2: Float32) -> Float64:
    bins = np.log10(np.maximum(lengths_m, _SHORTEST_M) / _SHORTEST_M) * _PER_DECADE
    rows = np.clip(bins, 0, _BINS - 1).astype(np.int64)
    areas_of_bins: Float64 = np.bincount(rows, areas_m2.astype(np.float64), _BINS).astype(
        np.float64
    )
    return areas_of_bins


def _bin_median(areas_m2: Float64) -> float:
    """Median length, the middle of its bin, to four digits."""
    total = np.cumsum(areas_m2)
    row = int(np.searchsorted(total, 0.5 * total[-1]))
    return float(f"{_SHORTEST_M * 10 ** ((row + 0.5) / _PER_DECADE):.4g}")
