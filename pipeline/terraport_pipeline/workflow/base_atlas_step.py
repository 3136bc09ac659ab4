"""The build's step that draws the base's image in scenes whose segments have vertex colours."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import xxhash

from terraport_payload.types import Bool
from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages.texture import faces_only
from terraport_pipeline.stages.tiles import base_atlas
from terraport_pipeline.stages.tiles.base_atlas import BaseAtlas
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles
from terraport_pipeline.workflow.stage_runner import StageRunner, Step
from terraport_pipeline.workflow.workdir import stage_key

__all__ = ["base_atlas_step"]


def base_atlas_step(
    runner: StageRunner,
    base: Mesh,
    kept: Bool,
    tiles: DetailTiles,
    digest: str,
    spacing_m: float,
    options: base_atlas.Options,
) -> Step[BaseAtlas]:
    """Draw the base's image, or take it up.

    Parameters
    ----------
    runner : StageRunner
    base : Mesh
    kept : ndarray of shape (B,), bool
        Base faces that are published.
    tiles : DetailTiles
    digest : str
        Of base and tiles.
    spacing_m : float
        Typical distance between the survey's points.
    options : base_atlas.Options
    """
    return runner.step(
        base_atlas.NAME,
        stage_key(
            base_atlas.NAME,
            code_digest(base_atlas.__name__),
            {**asdict(options), "spacing_m": spacing_m},
            {"tiles": digest, "base": xxhash.xxh3_128_hexdigest(np.packbits(kept).data)},
        ),
        lambda context: base_atlas.run(faces_only(base, kept), tiles, spacing_m, options, context),
        lambda result: result.facts,
        base_atlas.store,
        base_atlas.restore,
    )
