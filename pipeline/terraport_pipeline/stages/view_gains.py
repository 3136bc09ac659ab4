"""View gains: what makes photos of different exposure agree, once per scene."""

from __future__ import annotations

from collections.abc import Sequence

from terraport_pipeline.geometry.lens import View
from terraport_pipeline.geometry.occlusion import Occluder
from terraport_pipeline.geometry.photo_samples import neutral_gains
from terraport_pipeline.model import Float32, Mesh
from terraport_pipeline.stages.choose_views import Photos

__all__ = ["view_gains"]


def view_gains(
    base: Mesh, views: Sequence[View], photos: Photos, rays: Occluder, *, threads: int = 1
) -> Float32:
    """Find every photo's exposure, (views + 1, GAIN_COLUMNS) float32; neutral for now."""
    del base, photos, rays, threads
    return neutral_gains(len(views))
