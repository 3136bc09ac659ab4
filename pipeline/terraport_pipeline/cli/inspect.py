"""``terraport inspect``: what is in a scene or a survey, and whether cameras fit it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.status import Status
from rich.table import Table
from rich.text import Text

from terraport_pipeline.cli.from_options import command_of
from terraport_pipeline.cli.label import regions_table
from terraport_pipeline.errors import OptionError, ReadError, SurveyError
from terraport_pipeline.extent import Extent
from terraport_pipeline.free_memory import default_memory_bytes
from terraport_pipeline.mesh_statement import MeshStatement
from terraport_pipeline.option import EXTENT, parse_offset
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.survey.inputs import expand_input
from terraport_pipeline.survey_statement import SurveyStatement

if TYPE_CHECKING:
    from terraport_pipeline.survey.survey_files import SurveyFiles
    from terraport_store import SceneNotFoundError

__all__ = ["inspect", "register"]

_NOTHING_STATED: Final = SurveyStatement()
_PLAIN_MESH: Final = MeshStatement()

_SURVEY_TEXT: Final = frozenset({".xyz", ".csv", ".asc", ".pts", ".xyzrgb"})
"""Endings of text that is a survey, if it is no file of cameras; of any other its lines tell."""

_REGIONS: Final = 10
"""Regions in the table; --json has twice as many, terraport label --export has all."""


def register(app: typer.Typer) -> None:
    """Add ``terraport inspect`` to the command line `app`."""
    app.command("inspect")(command_of(inspect))


def inspect(
    target: Annotated[
        list[str],
        typer.Argument(
            help="Scene directory, or a scene's address (s3://...); a survey (a file, several, a "
            "folder, a pattern), alone or with --cameras; a mesh; or cameras alone.",
            show_default=False,
        ),
    ],
    cameras: Annotated[
        Path | None,
        typer.Option(
            help="Cameras of the survey's photos; looked for beside --photos otherwise.",
            show_default=False,
        ),
    ] = None,
    photos: Annotated[
        Path | None, typer.Option(help="Folder of the photos.", show_default=False)
    ] = None,
    camera_offset: Annotated[
        str | None,
        typer.Option(
            metavar="E,N,H",
            help="Metres to add to the cameras' coordinates, where no file says them.",
            show_default=False,
        ),
    ] = None,
    extent: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            metavar=EXTENT.metavar,
            help="Look only at the files of the survey that touch this rectangle, in the "
            "coordinates and the unit of its own CRS; with --cameras only at the points within.",
            show_default=False,
        ),
    ] = None,
    statement: SurveyStatement = _NOTHING_STATED,
    mesh: MeshStatement = _PLAIN_MESH,
    headers: Annotated[
        bool,
        typer.Option("--headers", help="Of a survey only what the files' headers say, at once."),
    ] = False,
    density_map: Annotated[
        Path | None,
        typer.Option(
            "--map",
            help="Write the density of the survey's points as a picture (PNG).",
            show_default=False,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Show what is in a scene or a survey, or whether the cameras of photos fit a survey.

    Of a scene: counts, sizes, regions, segments, attributes, coordinates. Reads manifest, index and
    region facts only, so it answers at once however large the scene is.

    Of a survey: what looks wrong, first; files, points, extent, CRS and units by their headers, at
    once; then, by at most five million points spread over it, density, spacing, noise, copies,
    colours and attributes, and what a build of it will make and take.

    Of a mesh: triangles, pieces, textures, and what states where it is.

    Of a survey with --cameras: also format, lenses, pixel size on the ground, how much of the cloud
    the photos show and how many each point is in, and with --photos whether their colours agree
    with the cloud's.

    For example:

        terraport inspect scenes/quarry

        terraport inspect s3://bucket/scenes/quarry

        terraport inspect scenes/quarry --json | jq .segments.faces

        terraport inspect model.obj

        terraport inspect delivery/

        terraport inspect delivery/ --map density.png

        terraport inspect delivery/ --extent 641200 8594700 641300 8594800

        terraport inspect survey.laz --cameras colmap/ --photos images/

        terraport inspect survey.laz --photos flight/

        terraport inspect odm-project/
    """
    for text in target:
        if "://" not in text:
            expand_input(Path(text))  # refuse a wrong name before slow imports
    from terraport_pipeline.cli.mesh_table import mesh_table
    from terraport_pipeline.engines.camera_files import has_cameras
    from terraport_pipeline.engines.odm_project import find_odm_project, originals_in
    from terraport_pipeline.mesh_inspection import inspect_mesh
    from terraport_pipeline.survey.find_mesh import find_mesh, is_mesh
    from terraport_pipeline.survey.find_survey import find_survey
    from terraport_pipeline.workflow.photo_input import cameras_beside
    from terraport_store import SceneNotFoundError, is_url

    console = Console(stderr=True, soft_wrap=True)
    within = None if extent is None else Extent(*extent)
    asked = _Asked(console, Console(), density_map, only_headers=headers, as_json=as_json)
    # (1) A scene in object storage; nothing else is read from there.
    addresses = [text for text in target if is_url(text)]
    if addresses:
        asked.show(*_scene_at(addresses[0], is_alone=len(target) == 1 and cameras is None))
        return
    paths = [Path(text) for text in target]
    # (2) Cameras with their survey; a project of OpenDroneMap has both.
    project = find_odm_project(paths[0]) if len(paths) == 1 else None
    if project is not None and project.cloud is not None and cameras is None:
        cameras = paths[0] if has_cameras(paths[0]) else None
        photos = photos or project.photos
    if camera_offset is not None and cameras is None and photos is None:
        raise OptionError("--camera-offset needs the cameras, or the photos that they lie beside")
    offset = None if camera_offset is None else parse_offset(camera_offset, "camera offset")
    if photos is not None:
        photos = originals_in(photos)
    if cameras is not None:
        survey = find_survey(paths, extent=within, statement=statement)
        _show_with_cameras(survey, cameras, photos, offset, asked)
        return
    # (3) A mesh.
    if is_mesh(paths[0]) and not mesh.as_points:
        given = find_mesh(paths, statement, mesh)
        assert given is not None
        with console.status("mesh"):
            facts = inspect_mesh(given)
        asked.show(facts, mesh_table(facts))
        return
    # (4) A folder or file of another kind: a scene, a project of cameras.
    no_scene: SceneNotFoundError | None = None
    if len(paths) == 1 and within is None and not statement.recorded:
        try:
            other = _scene_or_cameras(paths[0], photos)
        except SceneNotFoundError as error:
            no_scene = error
        else:
            if other is not None:
                asked.show(*other)
                return
    # (5) A survey. Damage is listed, not refused: this is what is asked. With photos and no
    # cameras the cameras lie beside them.
    try:
        survey = find_survey(paths, skip_damaged=True, extent=within, statement=statement)
    except SurveyError:
        if no_scene is not None:
            raise no_scene from None
        raise
    if photos is not None:
        _show_with_cameras(survey, cameras_beside(photos), photos, offset, asked)
        return
    asked.show(_inspect_survey(survey, asked))


@dataclass(frozen=True, slots=True)
class _Asked:
    """How facts are shown."""

    console: Console
    """Of progress."""
    out: Console
    density_map: Path | None
    only_headers: bool
    as_json: bool

    def show(self, facts: Mapping[str, Any], tables: RenderableType | None = None) -> None:
        """Print JSON, or tables; those of a survey were drawn while it was looked at."""
        if self.as_json:
            typer.echo(json.dumps(facts, indent=1))
        elif tables is not None:
            self.out.print(tables)


def _scene_at(url: str, *, is_alone: bool) -> tuple[dict[str, Any], Group]:
    """Gather and draw the facts of a scene at an address.

    Raises
    ------
    OptionError
        It is no scene, or something else is asked of it.
    """
    from terraport_pipeline.inspection import inspect_scene
    from terraport_store import SceneNotFoundError

    advice = "surveys, photos and cameras are read from this machine: fetch them first"
    if not is_alone:
        raise OptionError(f"{url}: only a scene is inspected at an address, alone; {advice}")
    try:
        facts = inspect_scene(url)
    except SceneNotFoundError as error:
        raise OptionError(f"{error}; {advice}") from None
    return facts, _tables(facts)


def _show_with_cameras(
    survey: SurveyFiles,
    cameras: Path,
    photos: Path | None,
    offset: tuple[float, float, float] | None,
    asked: _Asked,
) -> None:
    """Show a survey, and how well the cameras of its photos fit it."""
    from terraport_pipeline.camera_inspection import forecast_with_photos, inspect_photos
    from terraport_pipeline.cli.camera_tables import camera_tables
    from terraport_pipeline.progress import RichProgress

    survey_facts = _inspect_survey(survey, asked)
    with RichProgress(asked.console) as progress:
        facts = inspect_photos(survey, cameras, photos=photos, offset=offset, progress=progress)
    if photos is not None and "forecast" in survey_facts:
        facts["forecast"] = forecast_with_photos(survey_facts, facts)
    asked.show({**facts, "survey": survey_facts}, camera_tables(facts, cameras.name))


def _scene_or_cameras(target: Path, photos: Path | None) -> tuple[dict[str, Any], Group] | None:
    """Gather and draw the facts of a scene or of cameras; None of what is neither by its kind.

    Raises
    ------
    SceneNotFoundError
        A folder that is neither; it may hold a survey.
    """
    from terraport_pipeline.camera_inspection import inspect_cameras
    from terraport_pipeline.cli.camera_tables import camera_tables
    from terraport_pipeline.engines.camera_files import has_cameras
    from terraport_pipeline.engines.readers.survey_format import is_binary_survey, is_foreign
    from terraport_pipeline.engines.readers.text_form import is_table
    from terraport_pipeline.inspection import inspect_scene
    from terraport_store import SceneNotFoundError

    no_scene: SceneNotFoundError | None = None
    if not target.is_file():
        try:
            facts = inspect_scene(target)
            return facts, _tables(facts)
        except SceneNotFoundError as error:
            no_scene = error
    is_other = target.is_file() and not is_binary_survey(target) and not is_foreign(target)
    if has_cameras(target) or is_other:
        try:
            facts = inspect_cameras(target, photos)
        except ReadError:
            if target.suffix.lower() not in _SURVEY_TEXT and not is_table(target):
                raise
            return None
        return facts, camera_tables(facts, target.name)
    if no_scene is not None:
        raise no_scene
    return None


def _inspect_survey(survey: SurveyFiles, asked: _Asked) -> dict[str, Any]:
    """Draw what the headers say as soon as they are read, then what the points say."""
    from terraport_pipeline.cli.survey_tables import point_tables, survey_tables
    from terraport_pipeline.engines.pictures import save_png
    from terraport_pipeline.progress import RichProgress
    from terraport_pipeline.report.density_picture import draw_density
    from terraport_pipeline.survey_inspection import inspect_headers, inspect_points
    from terraport_pipeline.workflow.build import usable_cores

    with RichProgress(asked.console) as progress:
        survey, heads = survey.heads(progress, check_meaning=False)
    facts = inspect_headers(survey, heads)
    if not asked.as_json:
        asked.out.print(survey_tables(facts))
    if asked.only_headers or facts["refused"] is not None:
        return facts
    shown = facts["warnings"]
    with asked.console.status("points") as status:
        facts, density = inspect_points(
            survey,
            heads,
            facts,
            max_memory_bytes=default_memory_bytes(),
            threads=usable_cores(),
            progress=_StepNames(status),
        )
    if asked.density_map is not None and density is not None:
        save_png(draw_density(density), asked.density_map)
    if not asked.as_json:
        asked.out.print(point_tables(facts, shown))
    return facts


class _StepNames(NullProgress):
    """Names the step that runs beside the spinner: all of them together take seconds."""

    def __init__(self, status: Status) -> None:
        self._status = status

    def start(self, stage: str, _total: float | None, _unit: str) -> None:
        """Name a step."""
        self._status.update(escape(stage))


def _tables(facts: Mapping[str, Any]) -> Group:
    heading = Text.assemble((str(facts["name"]), "bold"), f"  version {facts['version'][:12]}")
    warnings = [Text(f"to know: {text}", style="yellow") for text in facts["build"]["warnings"]]
    regions = facts["regions"]
    listed = [regions_table(regions["largest"], _REGIONS)] if regions["largest"] else []
    if regions["problem"]:
        warnings.append(Text(f"regions: {regions['problem']}", style="yellow"))
    return Group(heading, _summary(facts), *listed, _segments(facts), _files(facts), *warnings)


def _summary(facts: Mapping[str, Any]) -> Table:
    """Draw a row per fact of the whole scene; what the manifest may lack is said to be missing."""
    from terraport_pipeline.report.facts import extent_line, input_line
    from terraport_pipeline.report.scene_colour import SceneColour

    counts, location = facts["counts"], facts["place"]
    size, crs, outline = location["size_m"], location["crs"], location["bounds_crs"]
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    # (1) where it is: CRS frame, metres
    named = "not stated" if crs is None else crs["name"]
    if crs is not None and crs["epsg"]:
        named += f" (EPSG:{crs['epsg']})"
    table.add_row("coordinates", named)
    table.add_row("origin", ", ".join(f"{value:,.3f}" for value in location["origin"]) + " m")
    table.add_row(
        "size",
        f"{size['east_west']:,.1f} m east-west, {size['north_south']:,.1f} m north-south, "
        f"{size['height']:,.1f} m high",
    )
    for axis, (low, high) in outline.items():
        table.add_row(axis, f"{low:,.2f} .. {high:,.2f} m")
    # (2) what is in it
    table.add_row("points", f"{counts['points']:,}")
    table.add_row(
        "detail", f"{counts['detail_faces']:,} triangles, {counts['detail_vertices']:,} vertices"
    )
    table.add_row(
        "base", f"{counts['base_faces']:,} triangles, {counts['base_vertices']:,} vertices"
    )
    table.add_row(
        "segments",
        f"{counts['segments']:,} in {counts['regions']:,} regions, "
        f"{facts['regions']['labelled']:,} of them with a label",
    )
    table.add_row("colour", str(SceneColour(**facts["colour"])))
    for attribute in facts["attributes"]:
        low, high = (attribute[end] for end in ("min", "max"))
        span = "no values" if low is None else f"{low:.6g} .. {high:.6g}"
        table.add_row(f"attribute {attribute['name']}", f"{span}, step {attribute['step']:.3g}")
    # (3) how exact it is
    hand_off = facts["hand_off"]
    table.add_row(
        "hand-off",
        f"levels {hand_off['deviation_m']:.3g} m apart, cover within "
        f"{hand_off['tolerance_m']:.3g} m, "
        f"{facts['cover']['base_faces_never_hidden']:,} base faces never hidden",
    )
    table.add_row("grid step", f"{location['grid_step_m'] * 1000:.4g} mm")
    # (4) where it comes from
    source = facts["build"]["input"]
    table.add_row("input", input_line(facts) or (source["name"] if source else "-"))
    if line := extent_line(facts):
        table.add_row("extent", line)
    table.add_row("built by", f"terraport {facts['build']['terraport']}")
    table.add_row("on disk", ", ".join(facts["versions_on_disk"]))
    return table


def _segments(facts: Mapping[str, Any]) -> Table:
    table = Table(title="Segments", title_justify="left", title_style="bold")
    table.add_column("")
    names = ("min", "p10", "median", "p90", "max", "mean")
    for name in names:
        table.add_column(name, justify="right")
    spreads = facts["segments"]
    for label, key, form in (
        ("triangles", "faces", "{:,.0f}"),
        ("bytes", "bytes", "{:,.0f}"),
        ("widest side m", "extent_m", "{:,.2f}"),
    ):
        table.add_row(label, *(form.format(spreads[key][name]) for name in names))
    over = facts["cover"]["segments_per_base_face"]
    table.add_row("segments per base face", *(f"{over[name]:,.1f}" for name in names))
    return table


def _files(facts: Mapping[str, Any]) -> Table:
    table = Table(title="Files", title_justify="left", title_style="bold")
    table.add_column("")
    table.add_column("bytes", justify="right")
    table.add_column("share", justify="right")
    for name, size in sorted(facts["files"].items(), key=lambda item: -int(item[1])):
        table.add_row(name, f"{size:,}", f"{size / max(1, facts['bytes']):.1%}")
    table.add_row(
        "in all",
        f"{facts['bytes']:,}",
        f"{facts['segments']['bytes_per_face']:.2f} bytes per triangle",
    )
    return table
