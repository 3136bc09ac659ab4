"""``terraport demo``: survey, scene, server and landings, with nothing of one's own."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import shlex
import shutil
import socket
import sys
import tempfile
import time
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.console import Console
from rich.table import Table

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.errors import PipelineError, StageFailedError
from terraport_pipeline.option import format_bytes, parse_count

if TYPE_CHECKING:
    import terraport.sync
    from terraport_pipeline.demo import DemoScene
    from terraport_server.background_server import BackgroundServer

__all__ = ["demo", "has_display", "register"]

RADIUS_M: Final = 60.0
STEP_M: Final = 70.0
"""How far the second landing is from the first: beyond the radius, so that some of it is new."""

LANDING_TIMEOUT_S: Final = 60.0

_HOST: Final = "127.0.0.1"


def register(app: typer.Typer) -> None:
    """Add ``terraport demo`` to the command line `app`."""
    app.command("demo")(demo)


def demo(
    points: Annotated[str, typer.Option(help="Points of the sample cloud: 250k, 1M.")] = "250k",
    port: Annotated[
        int, typer.Option(help="Port to serve on; 0: a free one.", min=0, max=65_535)
    ] = 0,
    photos: Annotated[
        bool,
        typer.Option(
            "--photos/--no-photos", help="Photograph the quarry too, and texture the scene."
        ),
    ] = True,
    serve: Annotated[
        bool, typer.Option("--serve/--no-serve", help="Go on serving until Ctrl-C.")
    ] = True,
    keep: Annotated[
        Path | None,
        typer.Option(
            help="Keep everything in this directory, and take up there next time.", file_okay=False
        ),
    ] = None,
    open_page: Annotated[
        bool | None,
        typer.Option(
            "--open/--no-open",
            help="Open the viewer in the browser, while serving. [default: where there is a "
            "display]",
        ),
    ] = None,
) -> None:
    """Show a scene that comes along at once; make and build a sample quarry beside it.

    Everything that terraport does, on data of its own. The page opens on a bench of the quarry
    within seconds. Meanwhile the whole quarry is made, photographed and built, one to four
    minutes on two cores, the first time longest; the page says how far it is, and when it can be
    opened. Then three landings in it: the third goes back to where the first was, and costs no
    byte.

    For example:

        terraport demo

        terraport demo --points 1M --keep demo --port 8080 --no-open
    """
    from terraport_pipeline.demo_scenes import QUARRY_ID, place_shipped_scene
    from terraport_server.background_server import BackgroundServer

    errors, console = Console(stderr=True), Console()
    started = time.perf_counter()
    with (
        reporting_errors(errors),
        # Had before minutes of work, not after: a taken port is said at once.
        _listening(port) as sockets,
        _directory(keep) as directory,
    ):
        count = parse_count(points, "points")
        # (1) serve the scene that comes along
        scenes = directory / "scenes"
        scenes.mkdir(exist_ok=True)
        place_shipped_scene(scenes)
        with (
            _announcing(scenes / QUARRY_ID) if _can_build() else contextlib.nullcontext(),
            BackgroundServer(scenes, sockets=sockets) as server,
        ):
            if serve:
                _show_shipped(console, server, started, open_page)
            if not _can_build():
                _say_extra(console, serve=serve)
                return
            # (2) survey, scene and report: what an earlier demo left in the folder is taken up
            demo_scene = _prepare(directory, count, errors, photos=photos)
            _print_steps(console, demo_scene)
            # (3) land in it, as a client would
            _await_quarry(server, demo_scene.build.version)
            _land(console, server.scene_url(QUARRY_ID))
            # (4) say where to look, and serve on
            console.print()
            for name, address in _pages(server).items():
                console.print(f"{name}  {address}", highlight=False, soft_wrap=True)
            seconds = time.perf_counter() - started
            console.print(f"from nothing to here: {seconds:,.0f} s", highlight=False)
            if serve:
                _wait(console)
        if keep is not None:
            command = shlex.join(["terraport", "serve", str(scenes)])
            text = f"kept in {keep}; {command} serves it again"
            console.print(text, markup=False, highlight=False, soft_wrap=True)


def has_display() -> bool:
    """Whether a browser that is opened here is seen by whoever asked.

    Without one, `webbrowser` would start a text browser in this very terminal.
    """
    if "SSH_CONNECTION" in os.environ:
        return False
    if sys.platform in {"win32", "darwin"}:
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _say_extra(console: Console, *, serve: bool) -> None:
    """Say what building needs, and go on serving what needs nothing."""
    needs = "the quarry is not built: that needs pip install 'terraport[server,pipeline]'"
    if not serve:
        raise PipelineError(needs)
    console.print(needs, markup=False, highlight=False, soft_wrap=True)
    _wait(console)


def _show_shipped(
    console: Console, server: BackgroundServer, started: float, open_page: bool | None
) -> None:
    """Say where the scene that comes along is to be seen, and open the browser on it."""
    from terraport_pipeline.demo_scenes import SHIPPED_ID, SHIPPED_VIEW

    viewer = server.viewer_url(SHIPPED_ID)
    address = server.url if viewer is None else f"{viewer}&{SHIPPED_VIEW}"
    console.print(f"viewer  {address}", highlight=False, soft_wrap=True)
    seconds = time.perf_counter() - started
    console.print(
        f"a bench of the quarry, after {seconds:,.1f} s",
        style="dim",
        highlight=False,
        soft_wrap=True,
    )
    if has_display() if open_page is None else open_page:
        webbrowser.open(address)


def _can_build() -> bool:
    """Return whether the extra that builds surveys is installed; showing a scene needs none."""
    return importlib.util.find_spec("numba") is not None


def _prepare(directory: Path, points: int, console: Console, *, photos: bool) -> DemoScene:
    """Make survey, scene and report."""
    # Here, after the page is shown: reconstruction, compilers and readers take seconds to import.
    from terraport_pipeline.demo import FLIGHT, prepare_demo
    from terraport_pipeline.progress import RichProgress
    from terraport_pipeline.warm import warming

    with warming(), RichProgress(console) as progress:
        return prepare_demo(
            directory, points=points, flight=FLIGHT if photos else None, progress=progress
        )


@contextlib.contextmanager
def _announcing(quarry: Path) -> Iterator[None]:
    """Announce the quarry before the page first asks, which is before anything of it begins."""
    from terraport_pipeline.demo_scenes import QUARRY_NAME
    from terraport_store import end_building, say_building

    say_building(quarry, QUARRY_NAME, "beginning", None)
    try:
        yield
    finally:
        end_building(quarry)


def _await_quarry(server: BackgroundServer, version: str) -> None:
    """Wait until the service has seen that version; it looks once a second."""
    from terraport_pipeline.demo_scenes import QUARRY_ID
    from terraport_server.errors import ServerError

    until = time.monotonic() + LANDING_TIMEOUT_S
    while time.monotonic() < until:
        with contextlib.suppress(ServerError):
            if server.service.registry.get(QUARRY_ID).version == version:
                return
        time.sleep(0.05)
    raise PipelineError(f"the service does not see {QUARRY_ID}: report this as a bug")


def _pages(server: BackgroundServer) -> dict[str, str]:
    """Return what there is to look at, the best first."""
    from terraport_pipeline.demo_scenes import QUARRY_ID

    viewer = server.viewer_url(QUARRY_ID)
    pages = {} if viewer is None else {"viewer": viewer}
    return pages | {"report": f"{server.scene_url(QUARRY_ID)}/report", "scenes": server.url}


@contextlib.contextmanager
def _listening(port: int) -> Iterator[list[socket.socket]]:
    from terraport_server.errors import ServerError
    from terraport_server.serving import listen

    try:
        sockets = listen(_HOST, port)
    except ServerError as error:
        raise PipelineError(str(error)) from error
    try:
        yield sockets
    finally:
        for one in sockets:
            one.close()


@contextlib.contextmanager
def _directory(keep: Path | None) -> Iterator[Path]:
    """Give the folder to work in: the one to keep, or one that goes unless the build failed."""
    if keep is None:
        temporary = Path(tempfile.mkdtemp(prefix="terraport-demo-"))
        try:
            yield temporary
        except StageFailedError as error:  # what is finished, and the trace, are in there
            command = shlex.join(["terraport", "demo", "--keep", str(temporary)])
            error.advice = f"what is finished is kept, and {command} goes on with it"
            raise
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
        shutil.rmtree(temporary, ignore_errors=True)
    else:
        keep.mkdir(parents=True, exist_ok=True)
        yield keep


def _print_steps(console: Console, demo_scene: DemoScene) -> None:
    table = Table(title="A scene from nothing", title_justify="left")
    table.add_column("step")
    table.add_column("time", justify="right")
    table.add_column("result")
    report = demo_scene.report
    holes = "not proved" if report.proof is None else f"{report.proof.holes} holes"
    results = {
        "make a quarry": f"{demo_scene.quarry.points:,} points, "
        f"{format_bytes(demo_scene.quarry.survey_bytes)} LAZ",
        "build the scene": f"version {demo_scene.build.version[:12]}, "
        f"{format_bytes(demo_scene.build.peak_bytes)} of memory at most",
        "write the report": f"{len(report.pictures)} pictures, {format_bytes(report.bytes)}, "
        f"hand-off: {holes}",
    }
    if demo_scene.photos is not None:
        results["photograph it"] = (
            f"{demo_scene.photos.photos} photos, {format_bytes(demo_scene.photos.bytes)}, "
            f"{demo_scene.photos.gsd_m * 100:.0f} cm a pixel"
        )
    for step, seconds in demo_scene.seconds:
        table.add_row(step, f"{seconds:,.1f} s", results[step])
    console.print(table)


def _land(console: Console, url: str) -> None:
    """Land in two places, then in the first again, and print what each cost."""
    import terraport.sync

    table = Table(title="Three landings with the Python SDK", title_justify="left")
    for name in ("", "first", "further on", "back again"):
        table.add_column(name, justify="left" if not name else "right")
    with terraport.sync.connect(url) as session:
        bounds = session.manifest()["bounds"]
        low, high = bounds["min"], bounds["max"]
        middle = ((low[0] + high[0]) / 2, (low[2] + high[2]) / 2)
        positions = [
            _ground(session, middle[0] + east_m, middle[1], high[1] + 10.0)
            for east_m in (0.0, STEP_M, 0.0)
        ]
        landings = []
        for position in positions:
            landing = session.land(position, RADIUS_M)
            landing.ready(LANDING_TIMEOUT_S)
            landings.append(landing)
        rows = {
            "at (x, y, z) m": [", ".join(f"{v:,.1f}" for v in position) for position in positions],
            "segments to load": [f"{len(landing.plan.load):,}" for landing in landings],
            "held already": [f"{len(landing.plan.keep):,}" for landing in landings],
            "triangles shown": [f"{landing.plan.total_triangles:,}" for landing in landings],
            "bytes received": [f"{landing.stats.streamed_bytes:,}" for landing in landings],
            "plan after": [_milliseconds(landing.stats.plan_s) for landing in landings],
            "first segment after": [
                _milliseconds(landing.stats.first_segment_s) for landing in landings
            ],
            "ready after": [_milliseconds(landing.stats.ready_s) for landing in landings],
        }
        for label, cells in rows.items():
            table.add_row(label, *cells)
    console.print(table)
    if landings[-1].stats.streamed_bytes:
        raise PipelineError(
            f"the return visit cost {landings[-1].stats.streamed_bytes} bytes, expected 0: "
            "report this as a bug"
        )


def _ground(
    session: terraport.sync.Session, x: float, z: float, top: float
) -> tuple[float, float, float]:
    """Ask the server where the ground is under a place."""
    hit = session.pick((x, top, z), (0.0, -1.0, 0.0))
    if hit is None:
        return (x, top, z)
    east, up, south = hit.position
    return (float(east), float(up), float(south))


def _milliseconds(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds * 1000:,.1f} ms"


def _wait(console: Console) -> None:
    """Serve until Ctrl-C."""
    with contextlib.suppress(KeyboardInterrupt):
        console.print("serving; Ctrl-C stops", style="dim")
        while True:
            time.sleep(3600)
