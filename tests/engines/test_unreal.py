"""The Unreal plugin on stubs of the engine, against the real service; compared with the Python SDK.

The engine itself is not run: see client_sdk/unreal/stubs/README.md.
"""

from __future__ import annotations

import json
import re
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from engines import cores
from engines.axes_pictures import PICTURE, drawn_by_sdk, drawn_by_unreal
from engines.conftest import TOKEN, skip_or_fail
from engines.engine_view import CONVENTIONS, draw
from engines.programs import ThreadedProxy
from engines.test_unreal_core import decoded, same_mesh
from engines.unreal import UNREAL, CoreTool, Unreal, Visited, missing
from engines.walk import BOUND_M, LANDING, STEPS, places, shown_by_the_sdk
from eventually import eventually
from faults.service import Service
from server.grid_scene import write_grid_scene

import terraport.sync
from terraport_pipeline.demo_scenes import SHIPPED_ID, shipped_scene
from terraport_server import BackgroundServer
from terraport_server.auth.keys import TokenKey, write_keys
from terraport_server.auth.tokens import make_token
from terraport_store import Scene

EVERYWHERE = "land:30,1,30,100"
SAME, DIFFERENT = 0.005, 0.02
"""Share of pixels that may differ, as outlines do by rounding; and that would be seen."""
WAIT_S = 60.0
KEY = TokenKey("k1", "HS256", bytes(range(32)))
RENEWED = "pause:5500"
"""Longer than a token lasts, and the wait before the next connection with it."""


def shown_by_sdk(url: str, *orders: tuple[float, float, float, float], **options: Any) -> list[Any]:
    """Land with the SDK; return the visible ids and the hidden base faces after each landing."""
    shown = []
    ring = options.pop("ring", None)
    with terraport.sync.connect(url, **options) as session:
        for x, y, z, radius_m in orders:
            coarse_m = None if ring is None else ring * radius_m
            session.land((x, y, z), radius_m, coarse_radius_m=coarse_m).ready()
            hidden = session.hidden_faces.nonzero()[0].tolist()
            shown.append((sorted(session.visible), hidden))
    return shown


def step(kind: str, place: tuple[float, ...]) -> str:
    return f"{kind}:{','.join(map(str, place))}"


def fine(visited: Visited) -> Visited:
    assert (visited.exit_code, visited["failure"]) == (0, None), visited.output[-3000:]
    for landing in visited["landings"]:
        assert landing["drawn_triangles"] == landing["visible_triangles"], landing
    return visited


# ---- landings


@pytest.mark.parametrize(("scene", "ring"), [("grid", None), ("levels", 3)])
def test_what_is_drawn_after_each_landing_is_what_the_sdk_shows(
    unreal: Unreal, server: Service, scene: str, ring: float | None
) -> None:
    """Segments, hidden base faces, triangles; a second visit costs no bytes."""
    url = f"{server.url}/scenes/{scene}"
    walk = [(30.0, 1.0, 30.0, 6.0), (12.0, 1.0, 44.0, 8.0), (5.0, 1.0, 5.0, 22.0)]
    walk.append(walk[0])
    expected = shown_by_sdk(url, *walk, ring=ring)
    visited = fine(unreal.visit(url, *(step("land", place) for place in walk)))
    assert [landing["visible"] for landing in visited["landings"]] == [ids for ids, _ in expected]
    assert visited["hidden_base_faces"] == expected[-1][1] != []
    assert visited["plans"][-1]["load_bytes"] == 0, "the way back sends nothing"
    assert visited["repeated_bytes"] == 0
    assert visited["payload_bytes"] == sum(plan["load_bytes"] for plan in visited["plans"])


@pytest.mark.parametrize("scene", ["grid", "axes", "tiny"])
def test_segments_are_those_of_the_sdk_array_for_array(
    unreal: Unreal, server: Service, scene: str, tmp_path: Path
) -> None:
    with (
        CoreTool(unreal) as tool,
        terraport.sync.connect(f"{server.url}/scenes/{scene}") as session,
    ):
        segments = session.land((0, 1, 0), 60).ready()
        manifest = session.manifest()
        for segment in segments:
            path = tmp_path / f"{segment.id}.tsg"
            path.write_bytes(segment.payload)
            same_mesh(decoded(tool, path, manifest["attributes"]), segment.arrays())


@pytest.mark.parametrize("budget", ["max_triangles", "max_segments"])
def test_budgets_are_never_exceeded(unreal: Unreal, server: Service, budget: str) -> None:
    url = f"{server.url}/scenes/grid"
    bound = {"max_triangles": 5000, "max_segments": 10}[budget]
    expected = shown_by_sdk(url, (30, 1, 30, 100), **{budget: bound})
    visited = fine(unreal.visit(url, EVERYWHERE, **{budget: bound}))
    assert [(visited["visible"], visited["hidden_base_faces"])] == expected
    (plan,) = visited["plans"]
    assert plan["omitted"] == 36 - len(visited["visible"]) > 0
    assert plan["effective_radius_m"] < 100


def test_a_newer_landing_supersedes_the_older(unreal: Unreal, server: Service) -> None:
    url = f"{server.url}/scenes/bigger"
    visited = fine(unreal.visit(url, "start:30,1,30,100", "land:5,1,5,2", credit_mib=1))
    (landing,) = visited["landings"]
    assert [(landing["visible"], visited["hidden_base_faces"])] == shown_by_sdk(url, (5, 1, 5, 2))
    assert visited["payload_bytes"] < visited["plans"][0]["load_bytes"] / 2


def test_what_leaves_the_cache_is_sent_again(unreal: Unreal, server: Service) -> None:
    walk = ["land:5,1,5,3", "land:55,1,55,3", "land:5,1,55,3", "land:5,1,5,3"]
    visited = fine(unreal.visit(f"{server.url}/scenes/grid", *walk, cache_mib=0))
    first, *_, last = visited["plans"]
    assert last["load_bytes"] == first["load_bytes"] > 0
    (shown,) = visited["landings"][-1]["visible"]
    assert shown == 0


def test_an_aim_brings_what_the_landing_needs(unreal: Unreal, server: Service) -> None:
    url = f"{server.url}/scenes/levels"
    visited = fine(unreal.visit(url, "aim:30,1,30,6", "land:30,1,30,6"))
    assert visited["plans"][0]["load_bytes"] == 0 < visited["payload_bytes"]


def test_picks_are_answered(unreal: Unreal, server: Service) -> None:
    url = f"{server.url}/scenes/grid"
    visited = fine(unreal.visit(url, "pick:5,50,5,0,-1,0", "pick:500,50,5,0,-1,0"))
    met, missed = visited["picks"]
    assert (met["hit"], met["segment"], missed["hit"]) == (True, 0, False)
    assert met["location"][0::2] == pytest.approx([5, 5], abs=1e-6)
    assert met["grade"] == pytest.approx(0.55, abs=0.01)


def test_a_landing_that_cannot_be_is_refused_and_the_next_one_goes_on(
    unreal: Unreal, server: Service
) -> None:
    url = f"{server.url}/scenes/grid"
    visited = unreal.visit(url, "land:0,1,0,100000", timeout_s=2)
    (failure,) = visited["failures"]
    assert (failure["code"], failure["fatal"], failure["landing"]) == ("radius_too_large", False, 1)
    fine(unreal.visit(url, "start:5,1,5,4", "land:5,1,5,3"))


def test_feet_stand_on_what_is_shown(unreal: Unreal, server: Service) -> None:
    """200 m over detail and base, as the SDK shows them; bodies are solid at the same height."""
    url = f"{server.url}/scenes/grid"
    ground = shown_by_the_sdk(url)
    walk = places().tolist()
    steps = [f"stand:{x!r},100,{z!r}" for x, z in walk]
    feet = fine(unreal.visit(url, step("land", LANDING), *steps))["feet"]
    assert len(feet) == STEPS
    on_detail = 0
    for (x, z), foot in zip(walk, feet, strict=True):
        expected = ground.height_m(x, z)
        assert (foot is None) == (expected is None), (x, z)
        if foot is not None and expected is not None:
            height_m, segment, solid_m = foot
            assert abs(height_m - expected[0]) <= BOUND_M
            assert abs(solid_m - height_m) <= BOUND_M
            on_detail += segment >= 0
    assert 20 < on_detail < len(feet) - 20, "the walk is on detail, and on the base"


@pytest.mark.parametrize(("scene", "radius_m"), [("grid", 25), ("levels", 8)])
def test_everything_that_a_visitor_does(
    unreal: Unreal, server: Service, scene: str, radius_m: int
) -> None:
    """Teleport in the dark of a fade, obstacles, groups, preview in the editor: tour.cpp."""
    fine(unreal.visit(f"{server.url}/scenes/{scene}", f"tour:{radius_m}"))


def test_places_and_pieces_are_those_of_the_sdk(unreal: Unreal, tmp_path: Path) -> None:
    """Regions that people have named are places to land at."""
    scene = tmp_path / SHIPPED_ID
    shutil.copytree(shipped_scene(), scene)
    (regions,) = scene.glob("v-*/regions.json")
    stable_id = json.loads(regions.read_text())["regions"][0]["stable_id"]
    labels = [{"stable_id": stable_id, "label": "Grube"}]
    (scene / "labels.json").write_text(
        json.dumps({"format": "terraport-labels", "format_version": "1.0", "labels": labels})
    )
    with Service(tmp_path) as service:
        url = f"{service.url}/scenes/{SHIPPED_ID}"
        visited = fine(unreal.visit(url, "land:0,0,0,5", "places:0"))
        with terraport.sync.connect(url) as session:
            expected, pieces = session.places(), session.coarser(0)
    (place,) = expected
    assert visited["places"] == [["Grube", 0, place.radius_m]]
    assert visited["pieces"] == [[p.cost, p.label or "", *[list(p.regions)]] for p in pieces] != []


def differing(first: Any, second: Any) -> float:
    """Return the share of pixels that are not nearly the same colour."""
    apart = np.abs(first.astype(int) - second.astype(int)).max(axis=2)
    return float((apart > 6).mean())


def test_the_engine_draws_what_the_sdk_draws(unreal: Unreal, server: Service) -> None:
    """Axes, units, winding and V; and a mirrored axis or a turned winding would be seen."""
    url, engine = f"{server.url}/scenes/axes", CONVENTIONS["unreal"]
    reference = draw(drawn_by_sdk(url), CONVENTIONS["scene"])
    meshes = drawn_by_unreal(unreal, url)
    picture = draw(meshes, engine)
    assert differing(picture, reference) < SAME
    sheet = np.asarray(PIL.Image.open(PICTURE).convert("RGB"))
    height, width, _ = picture.shape
    left = 2 * (width + 8)  # The third: python tests/engines/axes_pictures.py draws it.
    assert differing(sheet[:height, left : left + width], picture) < DIFFERENT
    for axis in range(3):
        sign = np.where(np.arange(3) == axis, -1, 1)
        wrong = [replace(mesh, positions=mesh.positions * sign) for mesh in meshes]
        assert differing(draw(wrong, engine), reference) > DIFFERENT
    wrong = [replace(mesh, faces=mesh.faces[:, [0, 2, 1]]) for mesh in meshes]
    assert differing(draw(wrong, engine), reference) > DIFFERENT


# ---- faults


def test_a_cut_line_is_mended_and_no_segment_comes_twice(unreal: Unreal, server: Service) -> None:
    with ThreadedProxy(server.url) as line:
        line.proxy.cuts = [900_000, 1_700_000, 900_000]
        visited = fine(unreal.visit(f"{line.url}/scenes/big", EVERYWHERE, credit_mib=1))
    assert visited["visible"] == list(range(36))
    assert visited["repeated_bytes"] == 0
    states = [link["state"] for link in visited["links"]]
    assert states.count("open") > 1
    assert states[:5] == ["connecting", "open", "waiting", "connecting", "open"]


def test_a_flipped_byte_is_noticed_and_the_segment_asked_for_again(
    unreal: Unreal, server: Service
) -> None:
    url = f"{server.url}/scenes/big"
    size = fine(unreal.visit(url, EVERYWHERE))["payload_bytes"]
    with ThreadedProxy(server.url) as line:
        proxy: Any = line.proxy
        proxy.flip_at = size // 2
        visited = fine(unreal.visit(f"{line.url}/scenes/big", EVERYWHERE))
        assert proxy.flip_at is None, "it was flipped"
    assert visited["visible"] == list(range(36))
    assert len(visited["plans"]) == 2
    assert visited["payload_bytes"] > size


def test_a_byte_that_went_bad_on_disk_is_a_segment_missing(unreal: Unreal, tmp_path: Path) -> None:
    own = write_grid_scene(tmp_path / "scenes" / "own")
    with Scene.open(own.path) as scene:
        offset = int(scene.index.offset[14]) + 40
        pack = scene.file_path("segments.pack")
    spoilt = bytearray(pack.read_bytes())
    spoilt[offset] ^= 0x10
    pack.write_bytes(spoilt)
    with Service(own.path.parent) as service:
        visited = fine(unreal.visit(f"{service.url}/scenes/own", EVERYWHERE))
    assert visited["visible"] == [segment for segment in range(36) if segment != 14]
    assert any(event.startswith("ready 1 ") for event in visited["events"])


def test_after_a_change_of_version_the_user_lands_again_where_they_stand(
    unreal: Unreal, tmp_path: Path
) -> None:
    """Its segments have one attribute more: none is decoded by the version before."""
    place, folder = (30.0, 1.0, 30.0, 22.0), tmp_path / "scenes"
    write_grid_scene(folder / "big", cells=80)
    with Service(folder) as service:

        def publish() -> None:
            eventually((tmp_path / "shown").exists, WAIT_S)
            service.kill()
            write_grid_scene(folder / "big", cells=80, seed=1, slope=True)
            service.start()

        url = f"{service.url}/scenes/big"
        steps = (step("land", place), f"touch:{tmp_path / 'shown'}", "swaps:2")
        _, visited = beside(publish, lambda: unreal.visit(url, *steps))
        fine(visited)
        expected = shown_by_sdk(url, place)
    assert [(visited["visible"], visited["hidden_base_faces"])] == expected
    assert [landing["landing"] for landing in visited["landings"]] == [1, 1]
    assert len(visited["plans"]) == 2, "no segment was taken for damaged"
    assert visited["repeated_bytes"] == 0


def test_a_service_that_is_killed_and_comes_back(unreal: Unreal, tmp_path: Path) -> None:
    write_grid_scene(tmp_path / "scenes" / "big", cells=80)
    with Service(tmp_path / "scenes") as first, ThreadedProxy(first.url) as line:
        line.proxy.bytes_per_s = 3_000_000

        def restart() -> None:
            while line.proxy.down_bytes < 1_500_000:
                time.sleep(0.01)
            first.kill()
            time.sleep(0.5)
            first.start()

        thread = threading.Thread(target=restart)
        thread.start()
        visited = unreal.visit(f"{line.url}/scenes/big", EVERYWHERE, credit_mib=1, timeout_s=60)
        thread.join()
    fine(visited)
    assert visited["visible"] == list(range(36))
    assert visited["repeated_bytes"] == 0


def test_a_server_that_is_away_is_asked_again(unreal: Unreal, server: Service) -> None:
    with ThreadedProxy(server.url) as line:
        line.proxy.refuse = True
        visited = unreal.visit(f"{line.url}/scenes/grid", "land:5,1,5,3", timeout_s=4)
    assert visited["failure"] == "land:5,1,5,3: timeout"
    codes = [(failure["code"], failure["fatal"]) for failure in visited["failures"]]
    assert codes[0] == ("unreachable", False)
    assert 2 <= len(codes) <= 4


def test_a_deadline_shows_the_inner_part_first(unreal: Unreal, server: Service) -> None:
    with ThreadedProxy(server.url) as line:
        line.proxy.bytes_per_s = 1_000_000
        visited = fine(
            unreal.visit(f"{line.url}/scenes/bigger", "land:30,1,30,100,15,1500", credit_mib=1)
        )
    inner, whole = visited["landings"]
    assert (inner["degraded"], whole["degraded"]) == (True, False)
    assert 0 < len(inner["visible"]) < len(whole["visible"]) == 36


# ---- disk


def test_a_second_run_reads_from_disk_and_damage_is_asked_for_again(
    unreal: Unreal, server: Service, tmp_path: Path
) -> None:
    url = f"{server.url}/scenes/grid"
    options: dict[str, Any] = {"disk": tmp_path, "disk_mib": 64}
    first = fine(unreal.visit(url, "land:30,1,30,22", "pause:300", **options))
    files = sorted((tmp_path / "Terraport").glob("*.segment"))
    assert len(files) == len(first["visible"])
    second = fine(unreal.visit(url, "land:30,1,30,22", **options))
    assert (second["visible"], second["payload_bytes"]) == (first["visible"], 0)
    spoilt = bytearray(files[0].read_bytes())
    spoilt[len(spoilt) // 2] ^= 1
    files[0].write_bytes(spoilt)
    files[1].write_bytes(b"")
    third = fine(unreal.visit(url, "land:30,1,30,22", "pause:300", **options))
    assert third["visible"] == first["visible"]
    assert 0 < third["payload_bytes"] < first["payload_bytes"]
    assert fine(unreal.visit(url, "land:30,1,30,22", **options))["payload_bytes"] == 0


def test_the_disk_keeps_its_bound_and_one_that_cannot_be_written_is_no_error(
    unreal: Unreal, server: Service, tmp_path: Path
) -> None:
    url = f"{server.url}/scenes/bigger"
    first = fine(unreal.visit(url, EVERYWHERE, "pause:300", disk=tmp_path, disk_mib=2))
    kept = sum(path.stat().st_size for path in (tmp_path / "Terraport").iterdir())
    assert 1_000_000 < kept <= 2 << 20 < first["payload_bytes"]
    again = fine(unreal.visit(url, EVERYWHERE, disk=tmp_path, disk_mib=2))
    assert again["visible"] == first["visible"]
    assert again["payload_bytes"] < first["payload_bytes"]
    fine(unreal.visit(url, "land:5,1,5,3", disk="/dev/null", disk_mib=2))


# ---- tokens


def test_a_token_opens_a_wrong_one_is_told_once_and_a_right_one_mends_it(
    unreal: Unreal, guarded: Service
) -> None:
    url = f"{guarded.url}/scenes/grid"
    fine(unreal.visit(url, "land:5,1,5,3", token=TOKEN))
    refused = unreal.visit(url, "land:5,1,5,3", token="not-the-right-token")
    assert refused["failure"] == "land:5,1,5,3: unauthorised"
    assert len(refused["failures"]) == 1
    assert TOKEN not in refused.output
    steps = ("pause:700", f"reconnect:{TOKEN}", "land:5,1,5,3")
    mended = unreal.visit(url, *steps, token="not-the-right-token")
    assert mended["failure"] is None
    assert mended["visible"] == [0]


def test_an_unknown_scene_is_told_and_not_asked_for_again(unreal: Unreal, server: Service) -> None:
    visited = unreal.visit(f"{server.url}/scenes/no-such-scene", "land:5,1,5,3")
    assert visited["failure"] == "land:5,1,5,3: unknown_scene"
    assert len(visited["failures"]) == 1


def token(valid_s: float) -> str:
    return make_token(
        KEY, name="anna", scenes=frozenset({"grid"}), expires_s=int(time.time() + valid_s)
    )


@pytest.fixture(scope="module")
def signed(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of `grid` where signed tokens are checked again ten times a second."""
    keys = tmp_path_factory.mktemp("keys") / "keys"
    write_keys(keys, [KEY.line()])
    with BackgroundServer(
        scenes, token_keys_file=keys, token_leeway_s=0.0, access_check_s=0.1
    ) as server:
        yield server.scene_url("grid")


@contextmanager
def renewing(path: Path) -> Iterator[None]:
    """A file with a token that lasts 2 to 3 s more, written again twice a second."""
    stopped = threading.Event()

    def write() -> None:
        fresh = path.with_suffix(".new")
        fresh.write_text(token(3))
        fresh.replace(path)

    def run() -> None:
        while not stopped.wait(0.5):
            write()

    write()
    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()


def test_a_session_outlives_its_tokens(unreal: Unreal, signed: str, tmp_path: Path) -> None:
    land, path = "land:30,1,30,22", tmp_path / "token"
    with renewing(path):
        visited = fine(unreal.visit(signed, land, RENEWED, land, token_file=path))
    assert [plan["load_bytes"] > 0 for plan in visited["plans"]] == [True, False]
    states = [link["state"] for link in visited["links"]]
    assert states[:5] == ["connecting", "open", "waiting", "connecting", "open"]
    path.write_text(token(2.5))
    ended = unreal.visit(signed, land, RENEWED, land, token_file=path)
    assert ended["links"][-1]["state"] == "closed"
    assert ended["links"][-1]["close_code"] == 4401


# ---- groups


def beside(work: Callable[[], Any], run: Callable[[], Visited]) -> tuple[Any, Visited]:
    """Run a program while something else happens; return what came of both."""
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(work)
        visited = run()
        return other.result(WAIT_S), visited


@pytest.mark.parametrize("follows", [True, False])
def test_a_member_goes_where_the_guide_goes_if_it_follows(
    unreal: Unreal, server: Service, follows: bool
) -> None:
    url, group_name = f"{server.url}/scenes/grid", f"unreal-led-{follows}"

    def lead() -> tuple[Any, list[int]]:
        with terraport.sync.connect(url) as session:
            group = session.join_group(group_name, role="guide", name="Ada")
            group.members_present(2, timeout_s=WAIT_S)
            there = group.land_group((30, 1, 30), 22)
            there.land().ready()
            return there.all_there(timeout_s=WAIT_S), sorted(session.visible)

    steps = [f"follow:{int(follows)}", f"join:{group_name},member,Bo", "barrier:1"]
    (arrivals, visible), visited = beside(lead, lambda: unreal.visit(url, *steps))
    fine(visited)
    assert visited["member"] in (arrivals.ready if follows else arrivals.missing)
    assert visited["visible"] == (visible if follows else [])
    assert "called 30 1 30 22" in visited["events"]


def test_a_guide_takes_the_sdk_along_and_a_seat_outlives_a_cut_line(
    unreal: Unreal, server: Service
) -> None:
    name = "unreal-guide"
    with ThreadedProxy(server.url) as line:

        def follow() -> tuple[list[int], tuple[float, ...]]:
            with terraport.sync.connect(f"{server.url}/scenes/grid") as session:
                calls = iter(session.join_group(name))
                call = next(calls)
                call.land().ready()
                call.all_there(timeout_s=WAIT_S)
                line.cut()
                call = next(calls)
                call.land().ready()
                return list(call.all_there(timeout_s=WAIT_S).ready), (*call.position, call.radius_m)

        steps = (f"join:{name},guide", "people:2", "gather:30,1,30,22", "barrier:1", "pause:2000")
        more = ("gather:12,1,44,15", "barrier:2")
        (ready, place), visited = beside(
            follow, lambda: unreal.visit(f"{line.url}/scenes/grid", *steps, *more)
        )
    fine(visited)
    assert place == (12, 1, 44, 15)
    assert sorted(ready) == sorted(visited["gatherings"][-1]["ready"])
    assert visited["member"] in ready


def test_a_second_guide_is_refused(unreal: Unreal, server: Service) -> None:
    url = f"{server.url}/scenes/grid"
    with terraport.sync.connect(url) as session:
        session.join_group("unreal-taken", role="guide")
        second = unreal.visit(url, "join:unreal-taken,guide")
    assert second["failure"] == "join:unreal-taken,guide: refused"


# ---- the pace of the engine's socket thread


def test_the_plugin_sets_the_pace_of_the_socket_thread_before_the_module_is_loaded(
    unreal: Unreal, server: Service
) -> None:
    """At the engine's own pace a landing takes as many rounds, each six frames instead of .2."""
    url = f"{server.url}/scenes/bigger"
    early = fine(unreal.visit(url, "land:30,1,30,8"))
    late = fine(unreal.visit(url, "land:30,1,30,8", late=1))
    assert (early["frame_time_s"], early["warnings"]) == (0.001, 0)
    assert (late["frame_time_s"], late["warnings"]) == (0.0333, 1)
    assert late["frames"] > 3 * early["frames"]


# ---- sources


@pytest.fixture(scope="module", autouse=True)
def compilers() -> None:
    if missing() is not None:
        skip_or_fail(f"the Unreal plugin cannot be compiled ({missing()})")


def test_the_modules_compile_as_each_engine_would() -> None:
    cores.run_logged(["sh", str(UNREAL / "stubs" / "compile.sh")])


def test_the_plugin_names_what_is_there() -> None:
    plugin = json.loads((UNREAL / "Terraport.uplugin").read_text())
    for module in plugin["Modules"]:
        name = module["Name"]
        rules = (UNREAL / "Source" / name / f"{name}.Build.cs").read_text()
        assert f"class {name}" in rules
        sources = "".join(p.read_text() for p in (UNREAL / "Source" / name).rglob("*.cpp"))
        assert re.search(rf"IMPLEMENT_(GAME_)?MODULE\(.*\b{name}\b", sources), name


def test_the_core_knows_no_engine_and_throws_nothing() -> None:
    core = UNREAL / "Source" / "Terraport" / "Private" / "Core"
    for path in [*core.rglob("*.h"), *core.rglob("*.cpp")]:
        code = re.sub(r"//.*", "", path.read_text())
        for word in (r"\bthrow\b", r"\bcatch\b", r"\bdynamic_cast\b", r"\bFString\b", r"\babort\("):
            assert not re.search(word, code), f"{path.name} has {word}"
        for include in re.findall(r'#include "([^"]+)"', code):
            assert include.startswith("Core/"), f"{path.name} includes {include}"
