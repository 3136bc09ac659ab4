"""The whole build: read, clean, reconstruct, segment, pack, each taken up where nothing changed.

The published bytes depend on the survey's bytes and on the options in :meth:`BuildOptions.recorded`
alone: not on the clock, the number of threads or where an earlier build was interrupted.
"""

from __future__ import annotations

import os
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

import psutil

from terraport_pipeline.engines.ktx2 import require_encoder
from terraport_pipeline.engines.readers.survey_stream import FileHead, survey_size
from terraport_pipeline.errors import OptionError, PipelineError
from terraport_pipeline.kernel_threads import limit_threads
from terraport_pipeline.option import BYTES, COMMON, COUNT, Option, Section, check_options
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.stages import clean, pack, reconstruct, segment
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.region_engine import check_segment_by
from terraport_pipeline.stages.tiles import base_atlas
from terraport_pipeline.survey_files import SurveyFiles, find_survey
from terraport_pipeline.unforeseen import build_failed
from terraport_pipeline.workflow import tiled_reconstruct
from terraport_pipeline.workflow.photo_input import LocatedPhotos, Texturing
from terraport_pipeline.workflow.publish_step import build_info, pack_once
from terraport_pipeline.workflow.read_step import (
    input_info,
    inputs_of,
    look_at_survey,
    read_once,
    survey_in_memory,
)
from terraport_pipeline.workflow.report import BuildReport, write_build_report
from terraport_pipeline.workflow.scene_lock import scene_locked
from terraport_pipeline.workflow.stage_runner import StageRunner, key_of
from terraport_pipeline.workflow.texture_step import texture_step, tiled_texturing
from terraport_pipeline.workflow.tile_memory import MemoryPlan, plan_memory
from terraport_pipeline.workflow.tiled import TiledSurface, check_tiled, segment_and_pack
from terraport_pipeline.workflow.tiled_reconstruct import TileOptions
from terraport_pipeline.workflow.workdir import StageRecord, WorkDirectory
from terraport_store.errors import StoreError
from terraport_store.layout import MANIFEST_NAME
from terraport_store.manifest import CrsInfo

__all__ = ["BuildOptions", "available_memory_bytes", "build", "default_work_directory"]

_MEMORY_SHARE: Final = 0.8
"""Share of the memory that is free at the start which a build allows itself."""

_MACHINE: Final = "Machine and tiles"
"""Heading of the options that change how a build runs, not what it makes."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """Inputs and options of a build, one group a stage."""

    survey: Annotated[Path | tuple[Path, ...], Option(is_argument=True, many=True)]
    """Point cloud: LAS, LAZ, COPC, PLY, XYZ/CSV, PCD or E57. A file, several, a folder of them, or
    a pattern in quotes."""
    scene: Annotated[Path, Option(flags=("--output", "-o"))]
    """Scene directory to publish, or to renew."""
    name: Annotated[str | None, Option(unset="the scene directory's name")] = None
    """The scene's name for people."""
    max_points: Annotated[
        int | None, Option(least=clean.MIN_POINTS, notation=COUNT, unset="all of them")
    ] = None
    """Thin the survey to this many points while reading: 500k, 5M."""
    skip_damaged: Annotated[bool, Option(heading="Surface")] = False
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
    """Memory that the build may take: 8G. A survey that needs more is built in tiles."""
    threads: Annotated[int | None, Option(heading=_MACHINE, least=1, unset="all cores")] = None
    """Threads at most. The result does not depend on it."""
    tiles: Annotated[TileOptions, Section(_MACHINE)] = field(default_factory=TileOptions)
    """How to go about a survey that does not fit into the memory."""

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
        return {
            "max_points": self.max_points,
            "clean": asdict(self.clean),
            "reconstruct": asdict(self.reconstruct),
            "segment": asdict(self.segment),
            "base_texture": self.base_texture,
        }


def default_work_directory(scene: Path) -> Path:
    """Where a build keeps its stages when not told."""
    return scene.parent / f".{scene.name}.work"


def available_memory_bytes() -> int:
    """Return what is free for this process: on the machine, or in its container if that is less."""
    free = int(psutil.virtual_memory().available)
    try:
        limit = Path("/sys/fs/cgroup/memory.max").read_text(encoding="ascii").strip()
        used = int(Path("/sys/fs/cgroup/memory.current").read_text(encoding="ascii"))
    except (OSError, ValueError):
        return free
    return free if limit == "max" else max(0, min(free, int(limit) - used))


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
    with scene_locked(scene):
        threads = options.threads or _cores()
        limit_threads(threads)
        runner = StageRunner(
            WorkDirectory(options.work or default_work_directory(scene)),
            resume=options.resume,
            progress=progress or NullProgress(),
            threads=threads,
            max_memory_bytes=options.max_memory_bytes
            or int(_MEMORY_SHARE * available_memory_bytes()),
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


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _run_stages(
    runner: StageRunner, survey: SurveyFiles, scene: Path, options: BuildOptions
) -> tuple[str, bool, dict[str, Any]]:
    """Run all stages; return the scene's version, whether it was published now, and its files."""
    # Photos that are not there are told of now, not after the reconstruction.
    photos = None if options.texture is None else options.texture.find(runner.progress)
    # (1) What the survey is, and whether it fits into memory; if not, all goes by tiles.
    survey, heads = look_at_survey(runner, survey)
    plan = _plan_memory(runner, heads, options)
    if plan.tiled:
        check_tiled(options.segment)  # refused now what cannot be done by tiles
        runner.progress.start("plan", None, "")
        runner.progress.done({"tiles": plan.why})
    record = read_once(runner, survey, max_points=options.max_points, bounded=plan.tiled)
    run = _run_tiled if plan.tiled else _run_whole
    return (*run(runner, record, scene, options, photos), inputs_of(survey, record))


def _run_whole(
    runner: StageRunner,
    record: StageRecord,
    scene: Path,
    options: BuildOptions,
    photos: LocatedPhotos | None,
) -> tuple[str, bool]:
    """Run all stages after reading on the survey in one piece."""
    # (1) The points, in memory when asked for.
    read = survey_in_memory(runner, record)
    # (2) Cloud, meshes, segments. Invariant: a stage's key holds its options and the digest of
    # its input, so a stage whose key is unchanged is taken up and its value is never loaded
    # unless asked for.
    if photos is not None and not runner.reports[-1].taken_up:
        photos.try_on(read.value(), runner.progress)
    cleaned = runner.step(
        clean.NAME,
        key_of(clean.NAME, asdict(options.clean), {"survey": read.record.digest}),
        lambda context: clean.run(read.value(), options.clean, context),
        lambda result: result.facts,
        clean.store,
        clean.restore,
    )
    read.release()
    # Known only now, and minutes before the stage that needs it.
    check_segment_by(options.segment.segment_by, cleaned.record.values["attributes"])
    reconstructed = runner.step(
        reconstruct.NAME,
        key_of(
            reconstruct.NAME,
            asdict(options.reconstruct),
            {"cloud": cleaned.record.digest},
        ),
        lambda context: reconstruct.run(cleaned.value(), options.reconstruct, context),
        lambda result: result.facts,
        reconstruct.store,
        reconstruct.restore,
    )
    segmented = runner.step(
        segment.NAME,
        key_of(
            segment.NAME,
            asdict(options.segment),
            {"meshes": reconstructed.record.digest},
        ),
        lambda context: segment.run(reconstructed.value(), options.segment, context),
        lambda result: result.facts,
        segment.store,
        segment.restore,
    )
    # (3) Textures, if asked for.
    crs = read.record.values["crs"]
    recorded = options.recorded()
    textured = None
    if options.texture is not None:
        recorded["texture"] = options.texture.recorded(photos)
        textured = texture_step(
            runner, options.texture, photos, crs, cleaned, reconstructed, segmented
        )
    info = build_info(recorded, input_info(record), runner.reports)
    # (4) Pack; its key holds everything that the manifest says.
    pack_options = options.pack_options()

    def publish(context: Context) -> pack.Packed:
        cloud = cleaned.value().cloud
        about = pack.About(
            origin=cloud.origin,
            crs=CrsInfo(**crs) if crs else None,
            points=len(cloud.points),
            has_colour=cloud.has_colour,
            build=info,
            spacing_m=cloud.spacing_m,
        )
        cleaned.release()
        return pack.run(
            scene,
            reconstructed.value(),
            segmented.value(),
            about,
            pack_options,
            context,
            None if textured is None else textured.value(),
        )

    key = key_of(
        pack.NAME,
        {**asdict(pack_options), "build": info.model_dump(mode="json"), "crs": crs},
        {
            "cloud": cleaned.record.digest,
            "meshes": reconstructed.record.digest,
            "labels": segmented.record.digest,
            **({} if textured is None else {"textures": textured.record.digest}),
        },
    )
    return pack_once(runner, scene, key, publish)


def _plan_memory(
    runner: StageRunner, heads: tuple[FileHead, ...], options: BuildOptions
) -> MemoryPlan:
    """Decide by the files' headers whether the survey is built in one piece."""
    size = survey_size(heads)
    points = min(size.points, options.max_points or size.points)
    return plan_memory(
        points,
        runner.max_memory_bytes,
        force=options.tiles.wanted,
        detail_depth=options.reconstruct.detail_depth,
        extent_m=size.extent,
        area_m2=size.area,
    )


def _run_tiled(
    runner: StageRunner,
    read: StageRecord,
    scene: Path,
    options: BuildOptions,
    photos: LocatedPhotos | None,
) -> tuple[str, bool]:
    """Run all stages after reading over tiles; as :func:`_run_whole`."""
    # (1) Everything up to tiles and base.
    reconstructed = tiled_reconstruct.run(
        runner,
        read,
        clean_options=options.clean,
        options=options.reconstruct,
        tiles=options.tiles,
        check=lambda names: check_segment_by(options.segment.segment_by, names),
    )
    crs = reconstructed.crs

    def about() -> pack.About:
        recorded = {**options.recorded(), "tile_depth": reconstructed.tile_depth}
        if options.texturing is not None:
            recorded["texture"] = options.texturing.recorded(photos)
        return pack.About(
            origin=reconstructed.origin,
            crs=CrsInfo(name=crs.name, wkt=crs.wkt, epsg=crs.epsg) if crs else None,
            points=reconstructed.points,
            has_colour=reconstructed.has_colour,
            build=build_info(recorded, input_info(read), runner.reports),
        )

    # (2) Segments, textures and the scene, tile by tile.
    surface = TiledSurface(
        reconstructed.base,
        reconstructed.tiles,
        reconstructed.deviation_m,
        reconstructed.digest,
        reconstructed.spacing_m,
    )
    texturing = None
    if options.texturing is not None:
        texturing = tiled_texturing(
            options.texturing, photos, reconstructed.samples, reconstructed.sample_colours,
            reconstructed.origin, reconstructed.crs, runner.max_memory_bytes,
        )  # fmt: skip
    return segment_and_pack(
        runner, scene, surface, options.segment, options.pack_options(), about, texturing,
        options.base_image if reconstructed.has_colour else None,
    )  # fmt: skip


def _check(options: BuildOptions) -> SurveyFiles:
    """Refuse at once what would end the build after an hour; return the survey's files."""
    scene = options.scene.absolute()
    survey = find_survey(options.inputs, skip_damaged=options.skip_damaged)
    try:
        scene.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OptionError(
            f"cannot make {scene.parent} for the scene to stand in: {error.strerror}"
        ) from error
    if scene.exists() and not scene.is_dir():
        raise OptionError(f"{scene} is a file; expected a scene directory or nothing")
    if scene.is_dir() and not (scene / MANIFEST_NAME).exists():
        others = [path for path in scene.iterdir() if not path.name.startswith((".v-", "v-"))]
        if others:
            raise OptionError(
                f"{scene} holds other files ({others[0].name}); expected a scene, or an empty or "
                "new directory"
            )
    if options.texture is not None and options.texture.options.kind == "ktx2":
        require_encoder()
    return survey
