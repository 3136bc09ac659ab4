"""``terraport land``: a landing without a headset."""

from __future__ import annotations

import asyncio
import json
import warnings
from collections.abc import AsyncIterator, Awaitable
from contextlib import asynccontextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.console import Console

from terraport.errors import (
    HttpError,
    LandingTimeoutError,
    OutsideSceneWarning,
    ServerError,
    UsageError,
)

if TYPE_CHECKING:
    from terraport.cli.group import GroupOptions
    from terraport.landing import Landing
    from terraport.trace import LandingTrace

__all__ = ["land", "register"]

_RADIUS_M: Final = 60.0
"""Of a landing where nobody says."""


def register(app: typer.Typer) -> None:
    """Add the command to `app`."""
    # A negative coordinate must not be taken for an option.
    app.command("land", context_settings={"ignore_unknown_options": True})(land)


def land(
    url: Annotated[
        str,
        typer.Argument(help="The scene: http(s)://HOST:PORT/scenes/ID.", show_default=False),
    ],
    x: Annotated[
        float | None, typer.Argument(help="Metres east of the origin.", show_default=False)
    ] = None,
    y: Annotated[
        float | None, typer.Argument(help="Metres above the origin.", show_default=False)
    ] = None,
    z: Annotated[
        float | None, typer.Argument(help="Metres south of the origin.", show_default=False)
    ] = None,
    radius: Annotated[
        float | None,
        typer.Option(
            help="Metres around the place. [default: 60, or what shows the region]",
            show_default=False,
        ),
    ] = None,
    coarse_radius: Annotated[
        float | None,
        typer.Option(
            help="Metres to which the coarser level is shown around that, where the scene has one "
            "(build --levels 2).",
            show_default=False,
        ),
    ] = None,
    region: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|ID",
            help="Instead of X Y Z: land where this region is seen best.",
            show_default=False,
        ),
    ] = None,
    crs: Annotated[
        bool,
        typer.Option("--crs", help="X Y Z are coordinates as the survey has them (E, N, H)."),
    ] = False,
    ground: Annotated[
        bool, typer.Option("--ground", help="Land on the surface above or below that place.")
    ] = False,
    token: Annotated[
        str | None,
        typer.Option(help="Bearer token.", envvar="TERRAPORT_TOKEN", show_envvar=True),
    ] = None,
    repeat: Annotated[int, typer.Option(min=1, max=1000, help="Land so many times.")] = 1,
    max_triangles: Annotated[
        int | None, typer.Option(min=0, help="Budget: triangles, nearest first.")
    ] = None,
    max_bytes: Annotated[
        int | None, typer.Option(min=0, help="Budget: payload bytes, nearest first.")
    ] = None,
    max_gpu_mebibytes: Annotated[
        int | None,
        typer.Option(min=0, help="Budget: MiB on a GPU, textures with their mips, nearest first."),
    ] = None,
    cache_dir: Annotated[
        Path | None, typer.Option(help="Keep segments here from one run to the next.")
    ] = None,
    timeout: Annotated[float, typer.Option(help="Seconds for each landing.")] = 300.0,
    group: Annotated[
        str | None, typer.Option(help="Land with this group; its guide says where.")
    ] = None,
    guide: Annotated[
        bool, typer.Option("--guide", help="Be the group's guide, who says where.")
    ] = False,
    members: Annotated[
        int, typer.Option(min=1, help="Members that a guide waits for, itself included.")
    ] = 1,
    member_name: Annotated[
        str | None, typer.Option("--as", help="What the group calls you.")
    ] = None,
    glb: Annotated[
        Path | None,
        typer.Option(help="Write base and detail at that landing as GLB, or FILE.obj as OBJ."),
    ] = None,
    png: Annotated[
        Path | None, typer.Option(help='Write a picture of it (needs "terraport[pipeline]").')
    ] = None,
    trace: Annotated[
        Path | None,
        typer.Option(help="Write what happened when, for https://ui.perfetto.dev (JSON)."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Land in a served scene: print the plan, times and bytes, and write what was received.

    For example:

        terraport land http://127.0.0.1:8080/scenes/pit 12 0 -40 --ground --radius 60

        terraport land http://127.0.0.1:8080 --crs 500012 8000040 103.5 --repeat 2 --png here.png

    The second landing at the same place costs no bytes: its segments are held.

        terraport land http://127.0.0.1:8080/scenes/pit --region "stockpile 3" --png here.png

    lands where that region is seen best.

        terraport land http://127.0.0.1:8080/scenes/pit --group tour --as Ben

        terraport land http://127.0.0.1:8080/scenes/pit 12 0 -40 --group tour --guide --members 2

    The first waits until the second, the guide, lands them both.
    """
    from terraport.cli.group import GroupOptions, place_of
    from terraport.cli.landing_files import require_pictures
    from terraport.options import Timeouts

    group_options = None if group is None else GroupOptions(group, guide, member_name, members)
    if region is not None and (x is not None or crs or ground):
        raise UsageError("got --region with X Y Z, --crs or --ground, expected one of them")
    if coarse_radius is not None and group is not None:
        raise UsageError("got --coarse-radius with --group, whose landings have one radius")
    is_led = group_options is not None and not group_options.guide
    if region is not None and is_led:
        raise UsageError("got --region as a member of a group, expected none: the guide says")
    coordinates = None if region is not None else place_of((x, y, z), group_options, repeat)
    # What cannot be written is said before the landing, which may take minutes.
    if png is not None:
        require_pictures()
    for file in (glb, png, trace):
        if file is not None and not file.absolute().parent.is_dir():
            raise UsageError(f"no directory {file.absolute().parent} to write {file.name} into")
    options: dict[str, Any] = {
        "max_triangles": max_triangles,
        "max_bytes": max_bytes,
        "max_gpu_mebibytes": max_gpu_mebibytes,
        "cache_dir": cache_dir,
        "timeouts": Timeouts(plan_s=timeout),
        "group": group,
    }
    with warnings.catch_warnings():
        # Said in this command's own words: before the landing, or after one that a guide called.
        warnings.simplefilter("ignore", OutsideSceneWarning)
        landing = _land(
            url,
            coordinates,
            radius,
            coarse_radius_m=coarse_radius,
            region=region,
            group_options=group_options,
            crs=crs,
            ground=ground,
            token=token,
            repeat=repeat,
            timeout_s=timeout,
            options=options,
            glb=glb,
            png=png,
            trace=trace,
            as_json=as_json,
        )
        asyncio.run(_with_advice(landing, url, token))


async def _with_advice(landing: Awaitable[None], url: str, token: str | None) -> None:
    """Land; of a refusal say what can be typed about it."""
    from terraport.cli.reach import explain_refusal

    try:
        await landing
    except (ServerError, HttpError) as error:
        explained = await explain_refusal(error, url, token)
        if explained is error:
            raise
        raise explained from error


async def _land(
    url: str,
    coordinates: tuple[float, float, float] | None,
    asked_radius_m: float | None,
    *,
    coarse_radius_m: float | None,
    region: str | None,
    group_options: GroupOptions | None,
    crs: bool,
    ground: bool,
    token: str | None,
    repeat: int,
    timeout_s: float,
    options: dict[str, Any],
    glb: Path | None,
    png: Path | None,
    trace: Path | None,
    as_json: bool,
) -> None:
    """Land, alone or with a group, and report the last landing.

    One session for all of it: what the first landing loaded is held for the next. Traces are
    written whatever happens, files and the report only of a landing that is ready.
    """
    from terraport.cli.group import land_together
    from terraport.cli.landing_files import write_landing
    from terraport.cli.landing_report import landing_facts, print_report, report_facts
    from terraport.cli.reach import nothing_there, require_reach
    from terraport.frames import to_scene
    from terraport.outside import SceneBox
    from terraport.places import find_place
    from terraport.session import connect

    traces: list[LandingTrace] = []
    async with connect(url, token, **options) as session, _traced(trace, traces):
        manifest = await session.manifest()

        # (1) Where to. A member of a group never asks: its guide says.
        place = None if region is None else find_place(await session.places(), region)
        radius_m = asked_radius_m or (_RADIUS_M if place is None else place.radius_m)

        async def target() -> tuple[float, float, float]:
            box = SceneBox.of(manifest)
            if place is not None:
                under = (
                    None if place.is_view else await session.pick(box.at_its_height(place.position))
                )
                return place.position if under is None else under.position
            assert coordinates is not None
            position = coordinates
            if crs:
                position = to_scene(coordinates, manifest["origin"], manifest.get("survey_units"))
            # From the scene's own heights: a pick does not reach down from anywhere.
            hit = await session.pick(box.at_its_height(position)) if ground else None
            if hit is None:
                require_reach(box, coordinates, position, radius_m, crs=crs, ground=ground)
            return position if hit is None else hit.position

        # (2) Land. The trace is noted before the wait: a landing that fails is asked about most.
        facts_of_landings, group_facts = [], None
        if group_options is not None:
            landing, group_facts = await land_together(
                session,
                group_options,
                target,
                radius_m,
                lambda landing: _watch(landing, 1, timeout_s),
                timeout_s,
            )
            position = landing.plan.position
            traces.append(landing.trace)
            facts_of_landings.append(landing_facts(landing))
        else:
            position = await target()
            for number in range(1, repeat + 1):
                landing = await session.land(position, radius_m, coarse_radius_m=coarse_radius_m)
                traces.append(landing.trace)
                await _watch(landing, number, timeout_s)
                facts_of_landings.append(landing_facts(landing))

        # (3) Write what was asked for, then say it: the report names the files.
        facts = await report_facts(session, position, manifest, facts_of_landings)
        if place is not None:
            facts["region"] = asdict(place)
        if group_facts is not None:
            facts["group"] = group_facts
        if glb is not None or png is not None:
            base = await session.base()
            facts["files"] = await asyncio.to_thread(
                write_landing, base, landing, manifest, glb=glb, png=png
            )
        if trace is not None:
            facts.setdefault("files", []).append({"file": str(trace)})
        if as_json:
            typer.echo(json.dumps(facts, indent=1))
        else:
            print_report(facts, landing)
        if not (landing.segments or landing.plan.omitted_segments):
            typer.echo(f"warning: {nothing_there(landing)}", err=True)


@asynccontextmanager
async def _traced(path: Path | None, traces: list[LandingTrace]) -> AsyncIterator[None]:
    """Write the traces at the end, also of landings that failed: those are asked about."""
    from terraport.trace import write_trace

    try:
        yield
    finally:
        if path is not None:
            await asyncio.to_thread(write_trace, path, traces)


async def _watch(landing: Landing, number: int, timeout_s: float) -> None:
    """Wait for a landing behind a progress bar (on a terminal)."""
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn())
    with Progress(
        *columns,
        TransferSpeedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        task = progress.add_task(f"landing {number}", total=landing.plan.total_bytes)
        try:
            async with asyncio.timeout(timeout_s):
                async for segment in landing:
                    progress.advance(task, len(segment.payload))
        except TimeoutError as error:
            # A timeout of the landing itself knows more than this one.
            if isinstance(error, LandingTimeoutError):
                raise
            await landing.ready(0.0)  # raises, and says how far it got
