"""From a survey's points to a surface: read, renew, clean, reconstruct."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from terraport_pipeline.engines.readers.survey_stream import FileHead, survey_size
from terraport_pipeline.errors import ResourceError
from terraport_pipeline.extent import Extent
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options.regions import Options as SegmentOptions
from terraport_pipeline.options.tiles import TileOptions
from terraport_pipeline.stages import clean
from terraport_pipeline.stages.region_engine import check_segment_by
from terraport_pipeline.survey.survey_files import SurveyFiles
from terraport_pipeline.workflow.before import find_before
from terraport_pipeline.workflow.brought import Brought
from terraport_pipeline.workflow.photo_input import LocatedPhotos
from terraport_pipeline.workflow.read_step import (
    crs_of,
    inputs_of,
    look_at_survey,
    read_once,
    units_of,
)
from terraport_pipeline.workflow.reconstruct_step import reconstruct_tiles
from terraport_pipeline.workflow.renew_step import renew_survey, survey_change
from terraport_pipeline.workflow.runner import Runner
from terraport_pipeline.workflow.tile_ground import clean_thinned, prepare
from terraport_pipeline.workflow.tile_memory import (
    WholeForecast,
    check_cells,
    count_cells,
    forecast_whole,
)

__all__ = ["bring_survey"]


def bring_survey(
    runner: Runner,
    survey: SurveyFiles,
    scene: Path,
    photos: LocatedPhotos | None,
    *,
    max_points: int | None,
    clean_options: clean.Options,
    reconstruct_options: reconstruct.Options,
    segment_options: SegmentOptions,
    tiles: TileOptions,
) -> Brought:
    """Reconstruct a survey, or take it up.

    Parameters
    ----------
    runner : Runner
    survey : SurveyFiles
    scene : Path
        Scene directory: the ground that changed since it was published is worked on.
    photos : LocatedPhotos or None
        Tried on the cloud before hours of work.
    max_points, clean_options, reconstruct_options, segment_options, tiles
        As of the build.

    Raises
    ------
    SurveyError, OptionError, ResourceError, EngineError
        As :func:`.build.build`.
    """
    # (1) What the survey is; its points on disk. Refused now what could never fit.
    survey, heads = look_at_survey(runner, survey)
    whole = _forecast_whole(heads, survey.extent, max_points, reconstruct_options.detail_depth)
    in_one_piece = segment_options.in_one_piece
    _check_in_one_piece(in_one_piece, whole, runner.max_memory_bytes)
    bounded = whole.memory_bytes > runner.max_memory_bytes
    read = read_once(runner, survey, max_points=max_points, bounded=bounded)
    # (2) Over a scene that is there: the ground that changed. A thinned copy tells whether
    # attributes and photos are what they should be.
    runner.before = find_before(runner.work, scene, read.digest)
    renewed, anew = renew_survey(runner, read)
    cleaned = clean_thinned(runner, renewed, clean_options)
    check_segment_by(segment_options.segment_by, cleaned.record.values["attributes"])
    if photos is not None and not runner.reports[-1].taken_up:
        cloud = cleaned.value().cloud
        colours = cloud.colours if cloud.has_colour else None
        photos.try_on(cloud.points, colours, cloud.origin, crs_of(read), runner.progress)
    # (3) The surface, in tiles.
    with runner.reported_as(reconstruct.NAME) as group:
        ground = prepare(
            runner, renewed, cleaned, clean_options, reconstruct_options, tiles, in_one_piece
        )
        points = ground.measured["points"]
        area_m2 = points * ground.measured["surface_spacing_m"] ** 2
        # Tiles also include their margins.
        faces = ground.forecast.faces * points / int(ground.plan.points.sum())
        cells = count_cells(segment_options, area_m2, faces)
        check_cells(cells, segment_options, runner.max_memory_bytes)
        reconstructed = reconstruct_tiles(runner, ground, tiles.cluster)
        facts = reconstructed.facts
        group.facts = replace(facts, warnings=(*anew, *facts.warnings))
    return Brought(
        surface=reconstructed.surface,
        source=read,
        worked_on=renewed.name,
        origin=ground.origin,
        crs=ground.crs,
        units=units_of(read),
        points=reconstructed.points,
        samples=reconstructed.samples,
        sample_colours=reconstructed.sample_colours,
        recorded={"tile_depth": reconstructed.tile_depth},
        inputs=inputs_of(survey, read),
        change=survey_change(runner, renewed, ground.lattice),
    )


def _forecast_whole(
    heads: tuple[FileHead, ...],
    extent: Extent | None,
    max_points: int | None,
    detail_depth: int | None,
) -> WholeForecast:
    """Forecast by the files' headers what the survey takes in one piece."""
    size = survey_size(heads, extent)
    return forecast_whole(
        min(size.points, max_points or size.points),
        detail_depth=detail_depth,
        extent_m=size.extent,
        area_m2=size.area,
    )


def _check_in_one_piece(
    in_one_piece: str | None, whole: WholeForecast, max_memory_bytes: int
) -> None:
    """Refuse before any work what needs the surface in one piece and cannot have it."""
    if in_one_piece and whole.memory_bytes > max_memory_bytes:
        raise ResourceError(
            f"{in_one_piece} needs the surface in one piece, {whole}; allowed are "
            f"{max_memory_bytes / 2**30:.1f} GiB: raise --max-memory, thin the survey with "
            "--max-points, or use --engine means and colour, which go by tiles"
        )
