"""``terraport land`` against the real service."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from glb_file import read_glb
from server.grid_scene import STEP_M, GridScene

from terraport import sync
from terraport.cli import app
from terraport_server import BackgroundServer


@dataclass(frozen=True)
class Shown:
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def land(capsys: pytest.CaptureFixture[str]) -> Callable[..., Shown]:
    """Run ``terraport land`` here: a process of its own each time takes seconds to start."""

    def run(*arguments: object) -> Shown:
        with pytest.raises(SystemExit) as exit_:
            app(["land", *map(str, arguments)], prog_name="terraport")
        out, err = capsys.readouterr()
        return Shown(exit_.value.code or 0, out, err)

    return run


def test_tables_for_people(land, server: BackgroundServer) -> None:
    """Plan, times and bytes; the second landing at the same place streams nothing."""
    shown = land(server.scene_url("grid"), 30, 1, 30, "--radius", 12, "--repeat", 2)
    assert shown.returncode == 0, shown.stderr
    lines = {line.split("  ")[0].strip(): line for line in shown.stdout.splitlines()}
    assert "landed at 30.00, 1.00, 30.00 m" in shown.stdout
    assert "E 500,030.00, N 7,999,970.00, H 101.00" in shown.stdout
    assert "landing 1" in shown.stdout
    assert "landing 2" in shown.stdout
    assert lines["streamed"].split()[-2:] == ["0", "B"]
    assert "ms" in lines["ready after"]
    assert shown.stderr == ""


def test_json_for_programs(land, server: BackgroundServer, grid: GridScene) -> None:
    shown = land(
        server.scene_url("grid"),
        30,
        1,
        30,
        "--radius",
        100,
        "--max-bytes",
        10_000,
        "--json",
    )
    facts = json.loads(shown.stdout)
    (landing,) = facts["landings"]
    assert facts["scene"]["version"] == grid.manifest.version
    assert landing["streamed_bytes"] == landing["load_bytes"] <= 10_000
    assert landing["omitted_by"] == "max_bytes"
    assert len(facts["visible_set_hash"]) == 16


def test_crs_coordinates_mean_the_same_place(land, server: BackgroundServer) -> None:
    """E N H of the survey, from the origin of the manifest; a negative number is no option."""
    by_crs = land(server.scene_url("grid"), 500_030, 7_999_970.5, 101, "--crs", "--json")
    by_scene = land(server.scene_url("grid"), 30, 1, 29.5, "--json")
    crs_plan, scene_plan = json.loads(by_crs.stdout), json.loads(by_scene.stdout)
    assert crs_plan["position"] == scene_plan["position"] == [30.0, 1.0, 29.5]
    assert crs_plan["visible_set_hash"] == scene_plan["visible_set_hash"]
    negative = land(server.scene_url("grid"), -3, -0.5, -1e1, "--json")
    assert json.loads(negative.stdout)["position"] == [-3.0, -0.5, -10.0]


def test_a_survey_in_feet_is_landed_in_with_its_own_coordinates(
    land, server: BackgroundServer
) -> None:
    """Heights have a unit of their own; what comes back is in the survey's units, too."""
    foot_m = 1200 / 3937
    given = (500_030 / foot_m, 7_999_970.5 / foot_m, 101 / 0.3048)
    facts = json.loads(land(server.scene_url("feet"), *given, "--crs", "--json").stdout)
    assert facts["position"] == pytest.approx([30.0, 1.0, 29.5], abs=1e-6)
    assert facts["position_crs"] == pytest.approx(given, rel=1e-12)
    shown = " ".join(land(server.scene_url("feet"), *given, "--crs").stdout.split())
    assert "E 1,640,515.09" in shown
    assert "in the survey's own units" in shown
    # Left out, --crs is what the message asks for: it knows the feet.
    beside = land(server.scene_url("feet"), *given)
    assert "As easting, northing and height it is: add --crs" in beside.stderr


def test_ground_puts_the_landing_onto_the_surface(land, server: BackgroundServer) -> None:
    """Whatever height was given; beside the scene there is none."""
    shown = land(server.scene_url("grid"), 30, 400, 30, "--ground", "--json")
    x, y, z = json.loads(shown.stdout)["position"]
    assert (x, z) == (30.0, 30.0)
    assert 0.4 <= y <= 1.6
    beside = land(server.scene_url("grid"), -100, 0, 0, "--ground")
    assert beside.returncode == 2
    assert "(-100, 0, 0) lies 100 m outside the scene" in beside.stderr


def test_glb_and_png_show_base_and_detail(
    land, server: BackgroundServer, grid: GridScene, tmp_path: Path
) -> None:
    """The mixed model: two base faces less and a segment more for each that is visible."""
    glb, png = tmp_path / "here.glb", tmp_path / "here.png"
    shown = land(
        server.scene_url("grid"), 30, 1, 30, "--radius", 12, "--glb", glb, "--png", png,
        "--json",
    )  # fmt: skip
    assert shown.returncode == 0, shown.stderr
    facts = json.loads(shown.stdout)
    count = facts["landings"][0]["load_segments"]
    model = read_glb(glb.read_bytes())
    assert len(model.faces) == 72 - 2 * count + facts["landings"][0]["total_triangles"]
    flat = model.positions * np.array([1, 0, 1])
    a, b, c = (flat[model.faces[:, corner]].astype(float) for corner in range(3))
    assert np.abs(np.cross(b - a, c - a)).sum() / 2 == pytest.approx(3600.0, abs=60 * STEP_M)
    assert png.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["here.glb", "here.png"]


def test_refusals_are_one_line(
    land, server: BackgroundServer, scenes_dir: Path, token: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for arguments, text in (
        (("nowhere", 0, 0, 0), "lists; it serves big, "),
        (("grid", 0, 0), "got X Y, expected x, y and z"),
        (("grid", 0, 0, 0, "--radius", 501), "radius_too_large"),
        (("grid", 0, 0, 0, "--radius", -1), "radius_m"),
        (("grid", 0, 0, 0, "--radius", "nan"), "radius_m"),
    ):
        failed = land(server.scene_url(arguments[0]), *arguments[1:])
        assert failed.returncode in (1, 2)
        assert failed.stderr.startswith("error: ")
        assert text in failed.stderr
        assert failed.stderr.count("\n") == 1
    with BackgroundServer(scenes_dir, token=token) as closed:
        url = closed.scene_url("grid")
        failed = land(url, 0, 0, 0, "--token", "wrong-wrong-wrong-wrong")
        assert failed.returncode == 1
        assert "unauthorised" in failed.stderr
        assert "; the one given is wrong, has expired, or is not for this service" in failed.stderr
        assert "wrong-wrong" not in failed.stderr
        for address in (url, closed.url):
            failed = land(address, 0, 0, 0)
            assert failed.returncode == 1
            assert failed.stderr.endswith("; give one by --token or TERRAPORT_TOKEN\n")
        monkeypatch.setenv("TERRAPORT_TOKEN", token)
        assert land(url, 0, 0, 0).returncode == 0


def test_a_guide_lands_a_group(land, server: BackgroundServer) -> None:
    """The guide waits for its member, which a thread plays; both stand at the same place."""
    url, seen = server.scene_url("grid"), []

    def follow() -> None:
        with sync.connect(url) as session:
            group = session.join_group("cli", name="Ben")
            call = next(iter(group))
            call.land().ready(20)
            seen.append((call.position, call.all_there(20), session.visible_set_hash()))

    with ThreadPoolExecutor(1) as pool:
        following = pool.submit(follow)
        shown = land(
            url, 30, 1, 30, "--radius", 12, "--group", "cli", "--guide", "--as", "Ann",
            "--members", 2, "--timeout", 20, "--json",
        )  # fmt: skip
        following.result(20)
    assert shown.returncode == 0, shown.stderr
    facts = json.loads(shown.stdout)
    assert (facts["group"]["role"], facts["group"]["complete"]) == ("guide", True)
    assert sorted(facts["group"]["ready"]) == ["Ann", "Ben"]
    ((position, arrivals, picture),) = seen
    assert list(position) == facts["position"] == [30, 1, 30]
    assert arrivals.complete
    assert picture == facts["visible_set_hash"]


def test_a_group_that_does_not_come_is_said(land, server: BackgroundServer) -> None:
    url = server.scene_url("grid")
    alone = land(url, 3, 1, 3, "--group", "x", "--guide", "--members", 9, "--timeout", 0.3)
    assert alone.returncode == 1
    assert "did not get together in 0.3 s: 1 present" in alone.stderr
    for arguments, text in (
        ((url, 3, 1, 3, "--group", "x"), "the guide says"),
        ((url, 3, 1, 3, "--group", "x", "--guide", "--repeat", 2), "--repeat"),
        ((url,), "expected x, y and z"),
    ):
        refused = land(*arguments)
        assert (refused.returncode, text in refused.stderr) == (2, True), refused.stderr
