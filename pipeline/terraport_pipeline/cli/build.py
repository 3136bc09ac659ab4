"""``terraport build``: from a survey to a published scene."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from urllib.parse import quote

import typer
from rich.console import Console

from terraport_pipeline.cli.edge import watching
from terraport_pipeline.cli.from_options import command_of
from terraport_pipeline.errors import PipelineError
from terraport_pipeline.options.build import BuildOptions
from terraport_pipeline.options.profiles import PROFILES, Profile, texture_options
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.survey.inputs import expand_input

if TYPE_CHECKING:
    from terraport_pipeline.engines.photos import OpenPhotos
    from terraport_pipeline.progress import Progress
    from terraport_pipeline.published.scene_model import SceneModel
    from terraport_pipeline.workflow.report import BuildReport

__all__ = ["build", "register"]


def register(app: typer.Typer) -> None:
    """Add ``terraport build`` to the command line `app`."""
    app.command("build")(command_of(build))


def _take_profile(context: typer.Context, profile: Profile | None) -> Profile | None:
    """Make a profile's values the defaults of the command's other options."""
    if profile is not None:
        context.default_map = {**(context.default_map or {}), **PROFILES[profile]}
    return profile


def build(
    options: BuildOptions,
    profile: Annotated[
        Profile | None,
        typer.Option(
            is_eager=True,
            callback=_take_profile,
            help="What the scene is for: sizes of segments and texels, and the form of textures, "
            "that fit what such devices hold. What is stated beside it counts. headset, phone: "
            "textures that stay compressed on the GPU (ktx2). desktop: as without.",
        ),
    ] = None,
    report: Annotated[
        bool, typer.Option(help="Write SCENE/report.html and report.pdf afterwards.")
    ] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no table.")] = False,
) -> None:
    """Turn a survey, or a mesh, into a scene: clean, reconstruct, segment, pack, publish.

    Over a scene that is there, a newer survey of the same ground renews what changed:
    clients that hold the rest keep it.

    Interrupt it whenever you like: the same command goes on after the last finished stage. The
    published scene is replaced in one act at the very end.

    For example:

        terraport build pit.laz                          makes the scene pit, here

        terraport build pit.laz -o scenes/pit            makes it elsewhere

        terraport build delivery/ -o scenes/pit          of all files of a folder

        terraport build 'tiles/*.laz' -o scenes/pit      of those of a pattern

        terraport build pit.laz --max-points 2M          a quick look first

        terraport build pit.laz --photos flight/images   with textures

        terraport build odm-project/ -o scenes/pit       all of an OpenDroneMap project

        terraport build pit.laz --extent 641200 8594700 641300 8594800

        terraport build model.obj                        a textured mesh, as it is

        terraport serve scenes                           shows what was built
    """
    for given in options.inputs:
        expand_input(given)  # refuse a wrong name before slow imports
    from terraport_pipeline.workflow.photo_input import photo_folder, project_texturing

    console = Console(stderr=True, soft_wrap=True)
    of_project = None if options.texture is not None else project_texturing(options.inputs)
    if of_project is not None and profile is not None:
        of_project = replace(of_project, options=texture_options(profile, of_project.options))
    if of_project is not None and options.base_texture:
        options = replace(options, texture=of_project)
        if not quiet:
            text = (
                f"textures from {photo_folder(of_project)}; name the cloud itself to build without"
            )
            console.print(text, markup=False, highlight=False)
    with watching(console, quiet=quiet) as progress:
        built = _build(options, console, progress, with_report=report)
    for text in () if quiet else (*built.notes, *built.choices):
        console.print(text, markup=False, highlight=False)
    for text in built.warnings:
        console.print(f"warning: {text}", markup=False, highlight=False)
    if not quiet:
        console.print(built.table())
        state = "published" if built.published else "is up to date"
        console.print(f"{built.scene} {state}", markup=False, highlight=False)
        for text in _last_lines(built.scene):
            console.print(text, markup=False, highlight=False)


def _last_lines(scene: Path) -> list[str]:
    """Say where the report is, the commands that serve the scene and land in it, and its tiles."""
    from terraport_store import read_manifest
    from terraport_store.layout import REPORT, REPORT_PDF

    lines = []
    if (scene / REPORT).exists():
        pdf = scene / REPORT_PDF
        lines.append(f"report  {scene / REPORT}{f'  {pdf}' if pdf.exists() else ''}")
    # A scene in the current directory is served by itself: beside it there is no scene, mostly.
    served = scene if scene.parent == Path.cwd() else scene.parent
    with suppress(ValueError):
        served = served.relative_to(Path.cwd())
    lines.append(f"serve   {shlex.join(['terraport', 'serve', str(served)])}")
    bounds, name = read_manifest(scene).bounds, quote(scene.name, safe="")
    middle = [(low + high) / 2 for low, high in zip(bounds.min, bounds.max, strict=True)]
    x, _, z = (f"{round(value)}" for value in middle)
    url = f"http://127.0.0.1:8080/scenes/{name}"
    lines.append(f"land    {shlex.join(['terraport', 'land', url, x, '0', z])} --ground")
    # Of the running service, for Cesium and other viewers; who wants files has export.
    lines.append(f"tiles   {url}/tileset.json")
    return lines


def _photos_beside(texturing: Texturing | None) -> Callable[[SceneModel], OpenPhotos] | None:
    """Open the build's photos again, for the report's pictures."""
    from terraport_pipeline.report.textures import open_scene_photos

    if texturing is None or texturing.photos is None:
        return None
    from terraport_pipeline.workflow.photo_input import photo_folder

    photos, cameras, offset = photo_folder(texturing), texturing.cameras, texturing.camera_offset
    return lambda model: open_scene_photos(model, photos, cameras, offset)


def _build(
    options: BuildOptions, console: Console, progress: Progress, *, with_report: bool
) -> BuildReport:
    from terraport_pipeline.workflow.build import build as run_build
    from terraport_store.layout import REPORT

    try:
        built = run_build(options, progress)
        if with_report and (built.published or not (built.scene / REPORT).exists()):
            _report(options, built, progress)
    except KeyboardInterrupt:
        console.print("the same command goes on after the last finished stage", highlight=False)
        raise
    return built


def _report(options: BuildOptions, built: BuildReport, progress: Progress) -> None:
    from terraport_pipeline.published.work_directory import default_work_directory
    from terraport_pipeline.report.input_cloud import find_input_cloud
    from terraport_pipeline.report.report import write_report
    from terraport_pipeline.unforeseen import stage_failed
    from terraport_store import StoreError

    try:
        write_report(
            built.scene,
            cloud=lambda scene: find_input_cloud(scene, options.work),
            photos=_photos_beside(options.texture),
            work=options.work,
            progress=progress,
        )
    except (PipelineError, StoreError, OSError):
        raise
    except Exception as error:
        raise stage_failed(
            error,
            "the report",
            f"{built.scene} is published and whole, and "
            f"{shlex.join(['terraport', 'report', str(built.scene)])} writes the report again",
            options.work or default_work_directory(options.scene),
        ) from error
