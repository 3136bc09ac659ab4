"""The build: read, clean, reconstruct, segment, texture, pack, taken up where nothing changed.

The published bytes depend on the survey's bytes and on the options in :meth:`BuildOptions.recorded`
alone: not on the clock, the number of threads or where an earlier build was interrupted.
"""

from __future__ import annotations

import os
import time
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import psutil

from terraport_pipeline.announced import announced
from terraport_pipeline.engines.ktx2 import require_encoder
from terraport_pipeline.engines.readers.survey_stream import FileHead, survey_size
from terraport_pipeline.errors import OptionError, PipelineError, ResourceError
from terraport_pipeline.extent import Extent
from terraport_pipeline.kernel_threads import limit_threads
from terraport_pipeline.option import (
    BYTES,
    COMMON,
    COUNT,
    EXTENT,
    Option,
    Section,
    check_options,
)
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.published.work_directory import default_work_directory
from terraport_pipeline.stages import clean, pack, reconstruct, segment
from terraport_pipeline.stages.region_engine import check_segment_by
from terraport_pipeline.stages.tiles import base_atlas
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey.survey_files import SurveyFiles
from terraport_pipeline.survey_statement import SurveyStatement
from terraport_pipeline.unforeseen import build_failed
from terraport_pipeline.workflow.before import find_before
from terraport_pipeline.workflow.pack_step import build_info, publish_tiles
from terraport_pipeline.workflow.photo_input import Texturing
from terraport_pipeline.workflow.read_step import (
    crs_of,
    input_info,
    inputs_of,
    look_at_survey,
    read_once,
    units_of,
)
from terraport_pipeline.workflow.reconstruct_step import reconstruct_tiles
from terraport_pipeline.workflow.renew_step import renew_survey, survey_change
from terraport_pipeline.workflow.report import BuildReport, write_build_report
from terraport_pipeline.workflow.runner import Runner
from terraport_pipeline.workflow.scene_lock import scene_locked
from terraport_pipeline.workflow.scene_path import check_scene_path, default_scene_path
from terraport_pipeline.workflow.segment_step import segment_tiles
from terraport_pipeline.workflow.texture_step import (
    texture_base_alone,
    texture_input,
    texture_tiles,
)
from terraport_pipeline.workflow.tile_ground import TileOptions, clean_thinned, prepare
from terraport_pipeline.workflow.tile_memory import WholeForecast, forecast_whole
from terraport_pipeline.workflow.workdir import WorkDirectory
from terraport_store.errors import StoreError
from terraport_store.manifest import CrsInfo

__all__ = [
    "BuildOptions",
    "available_memory_bytes",
    "build",
    "default_memory_bytes",
    "usable_cores",
]

_MEMORY_SHARE: Final = 0.8
"""Share of the memory that is free at the start which a build allows itself."""

_SURVEY: Final = "Survey"
"""Heading of the options that say what is read, and what it means."""

_MACHINE: Final = "Machine and tiles"
"""Heading of the options that change how a build runs, not what it makes."""


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """Inputs and options of a build, one group a stage."""

    survey: Annotated[Path | tuple[Path, ...], Option(is_argument=True, many=True)]
    """Point cloud: LAS, LAZ, COPC, PLY, XYZ/CSV, PCD or E57. A file, several, a folder of them, or
    a pattern in quotes."""
    output: Annotated[
        Path | None,
        Option(
            flags=("--output", "-o"),
            unset="the survey's name without its ending, in the current directory",
        ),
    ] = None
    """Scene directory to publish, or to renew."""
    name: Annotated[str | None, Option(unset="the scene directory's name")] = None
    """The scene's name for people."""
    max_points: Annotated[
        int | None, Option(least=clean.MIN_POINTS, notation=COUNT, unset="all of them")
    ] = None
    """Thin the survey to this many points while reading: 500k, 5M."""
    statement: Annotated[SurveyStatement, Section(_SURVEY)] = field(default_factory=SurveyStatement)
    """What the files do not say of the survey."""
    extent: Annotated[
        Extent | None, Option(heading=_SURVEY, notation=EXTENT, unset="all of it")
    ] = None
    """Build only the points within this rectangle, edges included, in the coordinates and the unit
    of the survey's own CRS: 641200 8594700 641300 8594800. Of COPC, and of LAS and LAZ with a
    LASindex (.lax), only what lies there is read."""
    skip_damaged: Annotated[bool, Option(heading=_SURVEY)] = False
    """Of a survey in several files, go on without those that cannot be read; the report names
    them."""
    clean: Annotated[clean.Options, Section("Surface")] = field(default_factory=clean.Options)
    reconstruct: Annotated[reconstruct.Options, Section("Surface")] = field(
        default_factory=reconstruct.Options
    )
    segment: Annotated[segment.Options, Section("Regions and segments")] = field(
        default_factory=segment.Options
    )
    texture: Annotated[Texturing | None, Section("Textures")] = None
    """Textures instead of vertex colours, from photos or for comparison from the colours."""
    base_texture: Annotated[int, Option(heading="Textures", unit="pixels")] = 2048
    """Longest side of the base's image, drawn from the photos, or without them from the colours of
    the points: 256, 512, 1024, 2048 or 4096. 0 leaves it the colours of its vertices."""
    work: Annotated[Path | None, Option(heading=_MACHINE, unset=".SCENE.work beside the scene")] = (
        None
    )
    """Work directory, with the results of all stages."""
    resume: Annotated[bool, Option(heading=COMMON)] = True
    """Take up stages of earlier builds whose input, options and code are unchanged."""
    max_memory_bytes: Annotated[
        int | None,
        Option(
            flags=("--max-memory",),
            heading=COMMON,
            least=2**28,
            notation=BYTES,
            unset=f"{_MEMORY_SHARE * 100:.0f} % of what is free",
        ),
    ] = None
    """Memory that the build may take: 8G. The less, the smaller the tiles."""
    threads: Annotated[int | None, Option(heading=_MACHINE, least=1, unset="all cores")] = None
    """Threads at most. The result does not depend on it."""
    tiles: Annotated[TileOptions, Section(_MACHINE)] = field(default_factory=TileOptions)
    """How large tiles are, and who works on them."""

    def __post_init__(self) -> None:
        check_options(self)
        self.pack_options()  # refused before any work, not after an hour
        if self.base_texture == 0 and self.texture is not None:
            raise OptionError(
                "base texture 0 pixels, in a scene with textures; expected 256 or more"
            )
        _ = self.base_image, self.texturing

    @property
    def inputs(self) -> tuple[Path, ...]:
        """What was given as the survey: files, folders, patterns."""
        return (self.survey,) if isinstance(self.survey, Path) else self.survey

    @property
    def scene(self) -> Path:
        """Scene directory: the one that was asked for, or one of the survey's name."""
        return default_scene_path(self.inputs) if self.output is None else self.output

    @property
    def base_image(self) -> base_atlas.Options | None:
        """Options of the base's image where no photo gives one; None where it has none."""
        return base_atlas.Options(self.base_texture) if self.base_texture else None

    @property
    def texturing(self) -> Texturing | None:
        """What textures are made of, the base's among them."""
        if self.texture is None:
            return None
        options = replace(self.texture.options, base_side=self.base_texture)
        return replace(self.texture, options=options)

    def pack_options(self) -> pack.Options:
        """Options of the pack stage, made from the scene's name."""
        name = self.scene.absolute().name if self.name is None else self.name
        return pack.Options(name)

    def recorded(self) -> dict[str, Any]:
        """Options that change the published bytes, as the manifest records them."""
        # Scenes without them keep the bytes that they had before there were these options.
        extent = {} if self.extent is None else {"extent": [*self.extent.values]}
        statement = {"statement": self.statement.recorded} if self.statement.recorded else {}
        return {
            "max_points": self.max_points,
            **extent,
            **statement,
            "clean": asdict(self.clean),
            "reconstruct": asdict(self.reconstruct),
            "segment": asdict(self.segment),
            "base_texture": self.base_texture,
        }


def available_memory_bytes() -> int:
    """Return what is free for this process: on the machine, or in its container if that is less."""
    free = int(psutil.virtual_memory().available)
    try:
        limit = Path("/sys/fs/cgroup/memory.max").read_text(encoding="ascii").strip()
        used = int(Path("/sys/fs/cgroup/memory.current").read_text(encoding="ascii"))
    except (OSError, ValueError):
        return free
    return free if limit == "max" else max(0, min(free, int(limit) - used))


def default_memory_bytes() -> int:
    """Memory that a build allows itself when not told."""
    return int(_MEMORY_SHARE * available_memory_bytes())


def build(options: BuildOptions, progress: Progress | None = None) -> BuildReport:
    """Build a scene from a survey and publish it.

    Parameters
    ----------
    options : BuildOptions
    progress : Progress, optional
        Silent by default.

    Returns
    -------
    BuildReport

    Raises
    ------
    SurveyError
        The survey cannot be used.
    OptionError
        An option is out of range, or the scene's path is taken by something else.
    ResourceError
        Too little memory or disk.
    EngineError
        A child process failed.
    BuildLockedError
        Another build of the same scene is running.
    WorkDirectoryError
        The work directory is damaged or not ours.
    StageFailedError
        Anything else: a fault of ours. Finished stages are kept, the scene is as it was.
    StoreError
        Publishing failed; the scene that was published before stands.
    """
    started = time.monotonic()
    survey = _check(options)
    scene = options.scene.absolute()
    with (
        scene_locked(scene),
        announced(scene, options.pack_options().name, progress or NullProgress()) as watcher,
    ):
        threads = options.threads or usable_cores()
        limit_threads(threads)
        runner = Runner(
            WorkDirectory(options.work or default_work_directory(scene)),
            resume=options.resume,
            progress=watcher,
            threads=threads,
            max_memory_bytes=options.max_memory_bytes or default_memory_bytes(),
        )
        try:
            version_of, published, files = _run_stages(runner, survey, scene, options)
            report = BuildReport(
                scene,
                version_of,
                published,
                tuple(runner.reports),
                time.monotonic() - started,
                **files,
            )
            write_build_report(report)
        except (PipelineError, StoreError, OSError):
            raise
        except Exception as error:
            finished = [stage.name for stage in runner.reports]
            raise build_failed(error, runner.stage, finished, runner.work.path) from error
    return report


def usable_cores() -> int:
    """Cores that this process may use, and a build does where it is not told."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _run_stages(
    runner: Runner, survey: SurveyFiles, scene: Path, options: BuildOptions
) -> tuple[str, bool, dict[str, Any]]:
    """Run all stages; return the scene's version, whether it was published now, and its files."""
    # (1) Photos that are not there are told of now, not after the reconstruction.
    photos = None if options.texture is None else options.texture.find(runner.progress)
    # (2) What the survey is; its points on disk. Refused now what could never fit.
    survey, heads = look_at_survey(runner, survey)
    whole = _forecast_whole(heads, options)
    _check_in_one_piece(options.segment.in_one_piece, whole, runner.max_memory_bytes)
    bounded = whole.memory_bytes > runner.max_memory_bytes
    read = read_once(runner, survey, max_points=options.max_points, bounded=bounded)
    # (3) Over a scene that is there: the ground that changed. A thinned copy tells whether
    # attributes and photos are what they should be.
    runner.before = find_before(runner.work, scene, read.digest)
    renewed, anew = renew_survey(runner, read)
    cleaned = clean_thinned(runner, renewed, options.clean)
    check_segment_by(options.segment.segment_by, cleaned.record.values["attributes"])
    if photos is not None and not runner.reports[-1].taken_up:
        photos.try_on(cleaned.value().cloud, crs_of(read), runner.progress)
    # (4) The surface, in tiles.
    with runner.reported_as(reconstruct.NAME) as group:
        ground = prepare(
            runner, renewed, cleaned, options.clean, options.reconstruct, options.tiles,
            options.segment.in_one_piece,
        )  # fmt: skip
        reconstructed = reconstruct_tiles(runner, ground, options.tiles.cluster)
        facts = reconstructed.facts
        group.facts = replace(facts, warnings=(*anew, *facts.warnings))
    # (5) Regions and segments, textures, payloads.
    surface = reconstructed.surface
    segmented = segment_tiles(runner, surface, options.segment)
    textures = base_texture = None
    recorded = {**options.recorded(), "tile_depth": reconstructed.tile_depth}
    if options.texturing is not None:
        recorded["texture"] = options.texturing.recorded(photos)
        asked = texture_input(
            options.texturing, photos, ground, reconstructed, runner.max_memory_bytes
        )
        textures = texture_tiles(runner, surface, segmented, asked)
        base_texture = textures.base
    elif options.base_image is not None and reconstructed.sample_colours is not None:
        base_texture = texture_base_alone(runner, surface, segmented, options.base_image)
    about = pack.About(
        origin=ground.origin,
        crs=None if ground.crs is None else CrsInfo(**asdict(ground.crs)),
        survey_units=units_of(read),
        points=reconstructed.points,
        has_colour=reconstructed.sample_colours is not None,
        build=build_info(recorded, input_info(read), runner.reports),
    )
    change = survey_change(runner, renewed, ground.lattice)
    version, published = publish_tiles(
        runner, scene, surface, segmented, textures, base_texture, about, options.pack_options(),
        change, prepare=partial(runner.prepare, about.build, read.digest, survey=renewed.name),
    )  # fmt: skip
    runner.remember(version, read.digest, survey=renewed.name)
    return version, published, inputs_of(survey, read)


def _forecast_whole(heads: tuple[FileHead, ...], options: BuildOptions) -> WholeForecast:
    """Forecast by the files' headers what the survey takes in one piece."""
    size = survey_size(heads, options.extent)
    return forecast_whole(
        min(size.points, options.max_points or size.points),
        detail_depth=options.reconstruct.detail_depth,
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


def _check(options: BuildOptions) -> SurveyFiles:
    """Refuse at once what would end the build after an hour; return the survey's files."""
    survey = find_survey(
        options.inputs,
        skip_damaged=options.skip_damaged,
        extent=options.extent,
        statement=options.statement,
    )
    check_scene_path(options.scene, options.inputs, is_default=options.output is None)
    if options.texture is not None and options.texture.options.kind == "ktx2":
        require_encoder()
    return survey
