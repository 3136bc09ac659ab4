"""The build's step that makes textures, between segmenting and packing."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from terraport_pipeline.model import Crs
from terraport_pipeline.photo_input import FoundPhotos, Texturing
from terraport_pipeline.stage_runner import StageRunner, Step, key_of
from terraport_pipeline.stages import texture
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.reconstruct import Reconstructed
from terraport_pipeline.stages.segment import Segmented
from terraport_pipeline.stages.texture_set import Textured

__all__ = ["texture_step"]


def texture_step(
    runner: StageRunner,
    asked: Texturing,
    found: FoundPhotos | None,
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
    found : FoundPhotos or None
        From ``asked.find``.
    crs : dict or None
        The survey's, as the read stage records it.
    cleaned, reconstructed, segmented : Step

    Returns
    -------
    Step of Textured
    """

    def compute(context: Context) -> Textured:
        opened = None
        if found is not None:
            opened = found.open(
                cleaned.value().cloud,
                Crs(**crs) if crs else None,
                max_bytes=texture.photo_bytes(context.max_memory_bytes),
            )
            cleaned.release()
        return texture.run(reconstructed.value(), segmented.value(), opened, asked.options, context)

    inputs = {"meshes": reconstructed.record.digest, "labels": segmented.record.digest}
    if found is not None:
        inputs |= {"photos": found.photos_xxh3, "cameras": found.cameras_xxh3}
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
