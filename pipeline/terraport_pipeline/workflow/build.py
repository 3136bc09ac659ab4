"""The build: read, clean, reconstruct, segment, texture, pack, taken up where nothing changed.

The published bytes depend on the survey's bytes and on the options in :meth:`BuildOptions.recorded`
alone: not on the clock, the number of threads or where an earlier build was interrupted.
"""

from __future__ import annotations

import os
import shutil
import time
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

from terraport_pipeline.announced import announced
from terraport_pipeline.engines.ktx2 import require_encoder
from terraport_pipeline.errors import OptionError, PipelineError
from terraport_pipeline.extent import Extent
from terraport_pipeline.free_memory import MEMORY_SHARE, default_memory_bytes
from terraport_pipeline.kernel_threads import limit_threads
from terraport_pipeline.mesh_statement import MeshStatement
from terraport_pipeline.naming.carried import (
    NOTE_NAME,
    UNNAMED_NAME,
    bring_names,
    note_names,
)
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
from terraport_pipeline.stages import clean, pack, reconstruct, segment, texture
from terraport_pipeline.stages.tiles import base_atlas
from terraport_pipeline.survey.find_mesh import MeshInput, find_mesh
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey.survey_files import SurveyFiles
from terraport_pipeline.survey_statement import SurveyStatement
from terraport_pipeline.unforeseen import build_failed
from terraport_pipeline.workflow.bring_survey import bring_survey
from terraport_pipeline.workflow.mesh_step import bring_mesh
from terraport_pipeline.workflow.pack_step import build_info, publish_tiles
from terraport_pipeline.workflow.photo_input import Texturing
from terraport_pipeline.workflow.read_step import input_info
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
from terraport_pipeline.workflow.tile_ground import TileOptions
from terraport_pipeline.workflow.workdir import WorkDirectory
from terraport_store import read_manifest
from terraport_store.errors import StoreError
from terraport_store.layout import MAX_LEVELS
from terraport_store.manifest import CrsInfo

__all__ = [
    "BuildOptions",
    "build",
    "usable_cores",
]


_SURVEY: Final = "Survey"
"""Heading of the options that say what is read, and what it means."""

_MACHINE: Final = "Machine and tiles"
"""Heading of the options that change how a build runs, not what it makes."""


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """Inputs and options of a build, one group a stage."""

    survey: Annotated[Path | tuple[Path, ...], Option(is_argument=True, many=True)]
    """Point cloud: LAS, LAZ, COPC, PLY, XYZ/CSV, PCD or E57; a file, several, a folder of them, or
    a pattern in quotes. Or a mesh that was reconstructed elsewhere: OBJ, GLB, glTF, PLY, STL
    or OFF."""
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
    mesh: Annotated[MeshStatement, Section(_SURVEY)] = field(default_factory=MeshStatement)
    """What a mesh does not say of itself."""
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
    levels: Annotated[int, Option(heading="Regions and segments", least=1, most=MAX_LEVELS)] = 1
    """Levels of every segment. 2 adds a coarser one with the same borders, a third of the bytes:
    clients that ask for it show it in a ring around the full detail, before the base begins."""
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
            unset=f"{MEMORY_SHARE * 100:.0f} % of what is free",
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
    def base_side(self) -> int:
        """Longest side of the base's image in a scene with textures.

        Raises
        ------
        OptionError
            None is wanted.
        """
        if self.base_texture == 0:
            raise OptionError(
                "base texture 0 pixels, in a scene with textures; expected 256 or more"
            )
        return self.base_texture

    @property
    def texturing(self) -> Texturing | None:
        """What textures are made of, the base's among them."""
        if self.texture is None:
            return None
        options = replace(self.texture.options, base_side=self.base_side)
        return replace(self.texture, options=options)

    def pack_options(self) -> pack.Options:
        """Options of the pack stage, made from the scene's name."""
        name = self.scene.absolute().name if self.name is None else self.name
        return pack.Options(name, self.levels)

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
            **({} if self.levels == 1 else {"levels": self.levels}),
        }


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
    given = _check(options)
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
            version_of, published, files = _run_stages(runner, given, scene, options)
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
    runner: Runner, given: SurveyFiles | MeshInput, scene: Path, options: BuildOptions
) -> tuple[str, bool, dict[str, Any]]:
    """Run all stages; return the scene's version, whether it was published now, and its files."""
    # (1) Photos that are not there are told of now, not after the reconstruction.
    photos = None if options.texture is None else options.texture.find(runner.progress)
    # (2) The surface: reconstructed, or brought.
    texturing = options.texturing
    if isinstance(given, MeshInput):
        own_textures = texturing is None or texturing.options.source == "mesh"
        brought = bring_mesh(
            runner, given, photos, textured=own_textures, options=options.reconstruct,
            segment_by=options.segment.segment_by,
        )  # fmt: skip
        if texturing is None and brought.texels is not None:
            texturing = Texturing(texture.Options(source="mesh", base_side=options.base_side))
    else:
        brought = bring_survey(
            runner, given, scene, photos, max_points=options.max_points,
            clean_options=options.clean, reconstruct_options=options.reconstruct,
            segment_options=options.segment, tiles=options.tiles,
        )  # fmt: skip
    # (3) Regions and segments, textures, payloads.
    surface = brought.surface
    segmented = segment_tiles(runner, surface, options.segment)
    textures = base_texture = None
    recorded = {**options.recorded(), **brought.recorded}
    if texturing is not None:
        recorded["texture"] = texturing.recorded(photos)
        asked = texture_input(texturing, photos, brought, runner.max_memory_bytes)
        textures = texture_tiles(runner, surface, segmented, asked)
        base_texture = textures.base
    elif options.base_image is not None and brought.sample_colours is not None:
        base_texture = texture_base_alone(runner, surface, segmented, options.base_image)
    source = brought.source
    about = pack.About(
        origin=brought.origin,
        crs=None if brought.crs is None else CrsInfo(**asdict(brought.crs)),
        survey_units=brought.units,
        points=brought.points,
        has_colour=brought.sample_colours is not None,
        build=build_info(recorded, input_info(source), runner.reports),
    )
    publish = partial(
        publish_tiles, runner, scene, surface, segmented, textures, base_texture, about,
        options.pack_options(), brought.change,
        prepare=partial(runner.prepare, about.build, source.digest, survey=brought.worked_on),
    )  # fmt: skip
    # (4) What people drew or taught would be lost under the engine's regions: it is cut into them
    # before anybody sees them, so that ids go on from what stands there.
    note, unnamed = runner.work.path / NOTE_NAME, runner.work.path / UNNAMED_NAME
    shutil.rmtree(unnamed, ignore_errors=True)  # of a build that was killed
    faces = sum(surface.tiles.face_count(tile) for tile in range(surface.tiles.count))
    said = note_names(scene, note, faces, runner.progress)
    if note.exists():
        packed, _ = publish(into=unnamed)
        stood = read_manifest(scene).version
        brought_names, version = bring_names(unnamed, scene, note, runner.progress)
        published = version != stood
        said += brought_names
        shutil.rmtree(unnamed, ignore_errors=True)
        note.unlink()
    else:
        packed, published = publish()
        version = packed
    if said:
        report = runner.reports[-1]
        facts = replace(report.facts, warnings=(*report.facts.warnings, *said))
        runner.reports[-1] = replace(report, facts=facts)
    runner.remember(packed, about.build, source.digest, survey=brought.worked_on)
    return version, published, dict(brought.inputs)


def _check(options: BuildOptions) -> SurveyFiles | MeshInput:
    """Refuse at once what would end the build after an hour; return the files of what was given."""
    given: SurveyFiles | MeshInput | None
    given = find_mesh(options.inputs, options.statement, options.mesh)
    if given is not None:
        _check_mesh(options)
    else:
        given = find_survey(
            options.inputs,
            skip_damaged=options.skip_damaged,
            extent=options.extent,
            statement=options.statement,
        )
        if options.texture is not None and options.texture.options.source == "mesh":
            raise OptionError(
                "textures from the mesh, of a point cloud; expected --photos, or a textured mesh"
            )
    check_scene_path(options.scene, options.inputs, is_default=options.output is None)
    if options.texture is not None and options.texture.options.kind == "ktx2":
        if options.levels > 1:
            raise OptionError(
                f"--levels {options.levels} with KTX2 textures, which nothing here makes smaller; "
                "expected --levels 1, or JPEG, WebP or PNG"
            )
        require_encoder()
    return given


def _check_mesh(options: BuildOptions) -> None:
    """Refuse what changes nothing of a mesh: it is taken as it is."""
    plain = replace(reconstruct.Options(), base_faces=options.reconstruct.base_faces)
    unused = {
        "--extent": options.extent is not None,
        "--max-points": options.max_points is not None,
        "--skip-damaged": options.skip_damaged,
        "options of cleaning": options.clean != clean.Options(),
        "options of the surface": options.reconstruct != plain,
        "options of tiles": options.tiles != TileOptions(),
    }
    stated = [name for name, is_stated in unused.items() if is_stated]
    if stated:
        raise OptionError(
            f"{stated[0]} with a mesh, which is neither cleaned nor reconstructed; expected "
            "--base-faces alone: leave it out, or take the mesh for points with --as-points"
        )
