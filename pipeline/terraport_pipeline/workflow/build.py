"""The build: read, clean, reconstruct, segment, texture, pack, taken up where nothing changed.

The published bytes depend on the survey's bytes and on the options in :meth:`BuildOptions.recorded`
alone: not on the clock, the number of threads or where an earlier build was interrupted.
"""

from __future__ import annotations

import os
import shutil
import time
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from terraport_pipeline.announced import announced
from terraport_pipeline.engines.ktx2 import require_encoder
from terraport_pipeline.errors import OptionError, PipelineError
from terraport_pipeline.free_memory import default_memory_bytes
from terraport_pipeline.kernel_threads import limit_threads
from terraport_pipeline.naming.carried import (
    NOTE_NAME,
    UNNAMED_NAME,
    bring_names,
    note_names,
)
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options.build import BuildOptions
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.options.tiles import TileOptions
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.published.work_directory import default_work_directory
from terraport_pipeline.stages import clean, pack, texture
from terraport_pipeline.survey.find_mesh import MeshInput, find_mesh
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey.survey_files import SurveyFiles
from terraport_pipeline.unforeseen import build_failed
from terraport_pipeline.workflow.bring_survey import bring_survey
from terraport_pipeline.workflow.mesh_step import bring_mesh
from terraport_pipeline.workflow.pack_step import build_info, publish_tiles
from terraport_pipeline.workflow.photo_input import locate_photos, recorded_textures
from terraport_pipeline.workflow.read_step import input_info
from terraport_pipeline.workflow.report import BuildReport, write_build_report
from terraport_pipeline.workflow.runner import Runner
from terraport_pipeline.workflow.scene_lock import scene_locked
from terraport_pipeline.workflow.scene_path import check_scene_path
from terraport_pipeline.workflow.segment_step import segment_tiles
from terraport_pipeline.workflow.texture_step import (
    texture_base_alone,
    texture_input,
    texture_tiles,
)
from terraport_pipeline.workflow.workdir import WorkDirectory
from terraport_store import read_manifest
from terraport_store.errors import StoreError
from terraport_store.manifest import CrsInfo

__all__ = [
    "BuildOptions",
    "build",
    "usable_cores",
]


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
    photos = None if options.texture is None else locate_photos(options.texture, runner.progress)
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
        recorded["texture"] = recorded_textures(texturing, photos)
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
