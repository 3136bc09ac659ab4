"""The build's step that makes textures, between segmenting and packing, whole or by tiles."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from terraport_payload.types import Float32, Float64, UInt8
from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.model import Crs
from terraport_pipeline.stages import texture
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.reconstruct import Reconstructed
from terraport_pipeline.stages.segment import Segmented
from terraport_pipeline.stages.texture_set import Textured
from terraport_pipeline.workflow import photo_input
from terraport_pipeline.workflow.photo_input import LocatedPhotos, Texturing
from terraport_pipeline.workflow.stage_runner import StageRunner, Step, key_of
from terraport_pipeline.workflow.tiled_textures import TiledTexturing

__all__ = ["texture_step", "tiled_texturing"]


def texture_step(
    runner: StageRunner,
    asked: Texturing,
    photo_source: LocatedPhotos | None,
    crs: dict[str, Any] | None,
    cleaned: Step[Cleaned],
    reconstructed: Step[Reconstructed],
    segmented: Step[Segmented],
) -> Step[Textured]:
    """Make the textures, or take them up.

    Parameters
    ----------
    runner : StageRunner
    asked : Texturing
    photo_source : LocatedPhotos or None
        From ``asked.find``.
    crs : dict or None
        The survey's, as the read stage records it.
    cleaned, reconstructed, segmented : Step

    Returns
    -------
    Step of Textured
    """

    # (1) Photos are opened, and the cloud loaded, only if the stage is not taken up.
    def compute(context: Context) -> Textured:
        opened = None
        if photo_source is not None:
            cloud = cleaned.value().cloud
            opened = photo_source.open(
                cloud.points,
                cloud.colours if cloud.has_colour else None,
                cloud.origin,
                Crs(**crs) if crs else None,
                max_bytes=texture.photo_bytes(context.max_memory_bytes),
            )
            cleaned.release()
        return texture.run(reconstructed.value(), segmented.value(), opened, asked.options, context)

    # (2) The key: meshes, labels, and photos and cameras by their content, wherever they lie.
    inputs = {"meshes": reconstructed.record.digest, "labels": segmented.record.digest}
    if photo_source is not None:
        inputs |= {
            "photos": photo_source.photos_xxh3,
            "cameras": photo_source.cameras_xxh3,
            "code": _code(),
        }
    return runner.step(
        texture.NAME,
        key_of(
            texture.NAME,
            {**asdict(asked.options), "camera_offset": asked.camera_offset, "crs": crs},
            inputs,
        ),
        compute,
        lambda result: result.facts,
        texture.store,
        texture.restore,
    )


def tiled_texturing(
    asked: Texturing,
    photo_source: LocatedPhotos | None,
    samples: Float32,
    colours: UInt8 | None,
    origin: Float64,
    crs: Crs | None,
    max_memory_bytes: int,
) -> TiledTexturing:
    """Say what the textures of a tiled build are made of.

    Parameters
    ----------
    asked : Texturing
    photo_source : LocatedPhotos or None
        From ``asked.find``.
    samples : ndarray of shape (N, 3), float32
        Points of the survey, scene frame.
    colours : ndarray of shape (N, 3), uint8, or None
        Theirs; None where the survey has none.
    origin : ndarray of shape (3,), float64
    crs : Crs or None
    max_memory_bytes : int

    Returns
    -------
    TiledTexturing
    """
    if photo_source is None:
        return TiledTexturing(asked.options, {})
    crs_values = None if crs is None else asdict(crs)
    return TiledTexturing(
        asked.options,
        {
            "camera_offset": asked.camera_offset,
            "crs": crs_values,
            "photos": photo_source.photos_xxh3,
            "cameras": photo_source.cameras_xxh3,
            "code": _code(),
        },
        lambda: photo_source.open(
            samples, colours, origin, crs, max_bytes=texture.photo_bytes(max_memory_bytes)
        ),
    )


def _code() -> str:
    """Digest of what decides on the photos before the stages see them."""
    return code_digest(photo_input.__name__)
