"""A landing outside the scene says so: in the SDK, and in `terraport land`."""

from __future__ import annotations

import asyncio
import json
import warnings
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
from server.grid_scene import GridScene

import terraport
from terraport.cli import app
from terraport_server import BackgroundServer
from terraport_store import Scene

# The scene `grid` reaches from 0 to 60 m east and south; its origin is E 500,000, N 8,000,000,
# H 100.


def run(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(work, 60))


@pytest.fixture
def land(
    server: BackgroundServer, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Run ``terraport land`` in `grid`; return exit code, stdout and stderr."""

    def run(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as exit_:
            app(["land", server.scene_url("grid"), *map(str, arguments)], prog_name="terraport")
        out, err = capsys.readouterr()
        code = exit_.value.code
        assert code is None or isinstance(code, int)
        return code or 0, out, err

    return run


def test_a_landing_far_outside_warns_and_knows_how_far(server: BackgroundServer) -> None:
    async def work() -> None:
        async with terraport.connect(server.scene_url("grid")) as session:
            with pytest.warns(
                terraport.OutsideSceneWarning, match="lies 940 m outside the scene"
            ) as caught:
                landing = await session.land((1000.0, 0.0, 30.0), 60.0)
            assert [warning.filename for warning in caught] == [__file__]
            assert "reaches from (0, " in str(caught[0].message)
            assert landing.outside_m == pytest.approx(940.0)
            assert await landing.ready(30.0) == ()

    run(work())


def test_within_reach_nothing_is_said(server: BackgroundServer) -> None:
    async def work() -> None:
        async with terraport.connect(server.scene_url("grid")) as session:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                for position in ((30.0, 1.0, 30.0), (-20.0, 1.0, 30.0)):
                    assert (await session.land(position, 60.0)).outside_m is None

    run(work())


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        ((1000, 0, 30), "nearest is (60, "),
        ((500_030, 7_999_970, 101), "As easting, northing and height it is: add --crs"),
        ((30, 1, 30, "--crs"), "As x, y and z of the scene it is: leave out --crs"),
        ((30, 900, 30), "There is ground above or below: add --ground"),
        ((1000, 0, 30, "--ground"), "lies 940 m outside the scene"),
    ],
)
def test_the_command_refuses_what_is_out_of_reach(
    land: Callable[..., tuple[int, str, str]],
    tmp_path: Path,
    arguments: tuple[object, ...],
    hint: str,
) -> None:
    code, out, err = land(*arguments, "--glb", tmp_path / "here.glb")
    assert code == 2
    assert out == ""
    assert err.startswith("error: ")
    assert "outside the scene, more than the radius of 60 m: nothing of it is there" in err
    assert hint in err
    assert not list(tmp_path.iterdir())


def test_ground_far_below_is_found_from_any_height(
    land: Callable[..., tuple[int, str, str]],
) -> None:
    code, out, err = land(30, 900, 30, "--ground", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["landings"][0]["load_segments"] > 0


def test_within_reach_of_the_box_and_of_no_detail(
    land: Callable[..., tuple[int, str, str]], grid: GridScene
) -> None:
    """Over a hollow: half a metre above the box's top, farther from the hollow's own."""
    with Scene.open(grid.path) as scene:
        boxes = scene.index.bounds
    low = boxes[boxes[:, 4].argmin()]
    position = ((low[0] + low[3]) / 2, float(boxes[:, 4].max()) + 0.45, (low[2] + low[5]) / 2)
    code, out, err = land(*position, "--radius", 0.5, "--json")
    facts = json.loads(out)["landings"][0]
    assert (code, facts["load_segments"], facts["outside_m"]) == (0, 0, None)
    assert err.startswith("warning: no detail within 0.5 m of there")
