"""The stages of a build on a survey in memory, as one tile: what tests of single stages look at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from memory_tiles import MemoryTiles, digest_of_mesh

from terraport_payload.types import Int32
from terraport_pipeline.model import Mesh, Survey
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.options.tiles import TileOptions
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages import clean
from terraport_pipeline.stages.contract import Facts, Stored
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles
from terraport_pipeline.stages.tiles.tiled_join import TiledSegmented
from terraport_pipeline.workflow.reconstruct_step import Reconstructed, Surface, reconstruct_tiles
from terraport_pipeline.workflow.runner import Runner
from terraport_pipeline.workflow.segment_step import Segmented, segment_tiles
from terraport_pipeline.workflow.tile_ground import Ground, clean_thinned, prepare
from terraport_pipeline.workflow.workdir import Cost, StageRecord, WorkDirectory


def runner_in(folder: Path, *, threads: int = 1, max_memory_bytes: int = 8 << 30) -> Runner:
    folder.mkdir(parents=True, exist_ok=True)
    return Runner(WorkDirectory(folder / "work"), True, NullProgress(), threads, max_memory_bytes)


def as_read(runner: Runner, survey: Survey) -> StageRecord:
    """Keep a survey as the read stage does."""
    arrays = {"points": survey.points} | {
        f"attribute-{i}": values for i, values in enumerate(survey.attributes.values())
    }
    if survey.colours is not None:
        arrays["colours"] = survey.colours
    crs = survey.crs
    values = {
        "attributes": list(survey.attributes),
        "crs": None if crs is None else {"name": crs.name, "wkt": crs.wkt, "epsg": crs.epsg},
        "format": survey.format,
        "whole": list(survey.whole),
    }
    return runner.work.save("read", "test", Stored(arrays, values), Facts(), Cost(0.0, 0))


@dataclass(frozen=True)
class ReconstructedSurvey:
    """Base and detail of a survey, as the tests look at them."""

    ground: Ground
    reconstructed: Reconstructed

    @property
    def base(self) -> Mesh:
        return self.reconstructed.surface.base

    @property
    def tiles(self) -> DetailTiles:
        return self.reconstructed.surface.tiles

    @property
    def detail(self) -> Mesh:
        assert self.tiles.count == 1
        return self.tiles.load(0)

    @property
    def deviation_m(self) -> tuple[float, ...]:
        return self.reconstructed.surface.deviation_m

    @property
    def digest(self) -> str:
        return self.reconstructed.surface.digest

    @property
    def cell_m(self) -> float:
        return self.reconstructed.cell_m

    @property
    def facts(self) -> Facts:
        return self.reconstructed.facts


def reconstruct_survey(
    runner: Runner,
    survey: Survey,
    options: reconstruct.Options,
    *,
    tiles: TileOptions | None = None,
    in_one_piece: str | None = "a test",
) -> ReconstructedSurvey:
    read = as_read(runner, survey)
    cleaned = clean_thinned(runner, read, clean.Options())
    ground = prepare(
        runner, read, cleaned, clean.Options(), options, tiles or TileOptions(), in_one_piece
    )
    return ReconstructedSurvey(ground, reconstruct_tiles(runner, ground))


def surface_in_tiles(
    base: Mesh, detail: Mesh, deviation_m: tuple[float, ...], *, along: int = 1
) -> Surface:
    """Two meshes in memory as a surface of along x along tiles."""
    tiles, digest = MemoryTiles.of(detail, along), digest_of_mesh(base)
    return Surface(base, tiles, deviation_m, digest, f"{digest}-{tiles.digest}")


@dataclass(frozen=True)
class Labelled:
    """Labels of a detail in one tile, in the numbers of the scene."""

    segmented: Segmented
    joined: TiledSegmented
    regions: Int32
    segments: Int32

    @property
    def facts(self) -> Facts:
        return self.joined.facts


def segment_surface(runner: Runner, surface: Surface, options: segment.Options) -> Labelled:
    segmented = segment_tiles(runner, surface, options)
    joined = segmented.joined.value()
    number = np.empty(len(joined.within), np.int32)
    number[joined.within] = np.arange(len(number), dtype=np.int32)
    labels = segmented.labels
    return Labelled(segmented, joined, labels.region(0), number[labels.segment(0)])
