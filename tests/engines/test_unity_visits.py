"""The core of the Unity package visits the real service: landings, faults, disk, tokens, groups."""

from __future__ import annotations

import gzip
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from engines.conftest import TOKEN
from engines.programs import ThreadedProxy
from engines.sdk_arrays import NORMAL_STEP, land_with_sdk, normals_apart
from engines.unity import Unity, Visit, digests
from engines.walk import BOUND_M, LANDING, STEPS, places, shown_by_the_sdk
from faults.service import Service
from server import grid_scene
from server.grid_scene import write_grid_scene

import terraport.sync
from terraport_server import BackgroundServer
from terraport_server.auth.keys import TokenKey, write_keys
from terraport_server.auth.tokens import make_token
from terraport_store import Scene, SceneWriter

EVERYWHERE = "land:30,1,30,100"
WAIT_S = 60.0
HERE = (30.0, 1.0, 30.0, 22.0)
THERE = (12.0, 1.0, 44.0, 15.0)
KEY = TokenKey("k1", "HS256", bytes(range(32)))


def steps(kind: str, *places: tuple[float, ...]) -> list[str]:
    return [f"{kind}:{','.join(map(str, place))}" for place in places]


# ---- landings


@pytest.mark.parametrize("threads", [0, 2], ids=["in frames", "on threads"])
def test_segments_are_those_of_the_python_sdk(
    unity: Unity, server: Service, threads: int, tmp_path: Path
) -> None:
    url = f"{server.url}/scenes/grid"
    (visible,), meshes = land_with_sdk(url, [HERE])
    visit = unity.land(url, *steps("land", HERE), decode_threads=threads, dump=tmp_path)
    assert visit.shown == [visible]
    assert 4 < len(visible) < 36
    assert {int(key): value for key, value in visit["segments"].items()} == {
        segment: digests(mesh) for segment, mesh in meshes.items()
    }
    assert normals_apart(meshes, tmp_path) <= NORMAL_STEP
    (plan,), (ready,) = visit.of("planned"), visit.of("ready")
    assert plan["load_bytes"] == plan["total_bytes"] == visit["payload_bytes"]
    assert ready["missing"] == []
    assert visit.states == ["connecting", "open"]


@pytest.mark.parametrize("scene", ["axes", "tiny"])
def test_images_colours_and_attributes_are_those_of_the_python_sdk(
    unity: Unity, server: Service, scene: str
) -> None:
    url = f"{server.url}/scenes/{scene}"
    _, meshes = land_with_sdk(url, [(0, 1, 0, 50)])
    visit = unity.land(url, "land:0,1,0,50")
    assert {int(key): value for key, value in visit["segments"].items()} == {
        segment: digests(mesh) for segment, mesh in meshes.items()
    }
    assert any(mesh.texture is not None for mesh in meshes.values()) == (scene == "axes")


def test_a_segment_that_cannot_be_drawn_is_left_out(unity: Unity, server: Service) -> None:
    """As an image in a format that the engine does not read."""
    url = f"{server.url}/scenes/axes"
    _, meshes = land_with_sdk(url, [(0, 1, 0, 50)])
    plain = sorted(segment for segment, mesh in meshes.items() if mesh.texture is None)
    visit = unity.land(url, "land:0,1,0,50", images=0)
    assert visit.shown == [plain]
    assert 0 < len(plain) < len(meshes)
    assert {event["code"] for event in visit.of("failed")} == {"unsupported_image"}
    assert visit.of("ready")[-1]["missing"] == sorted(set(meshes) - set(plain))


def test_a_walk_shows_and_hides_what_the_python_sdk_does(unity: Unity, server: Service) -> None:
    url = f"{server.url}/scenes/grid"
    walk = [(5.0 * step, 1.0, 7.0 * step % 55, 6.0 + step * 5 % 23) for step in range(12)]
    visit = unity.land(url, *steps("land", *walk))
    with terraport.sync.connect(url) as session:
        shown, hidden = [], []
        for x, y, z, radius_m in walk:
            session.land((x, y, z), radius_m).ready()
            shown.append(sorted(session.visible))
            hidden.append(session.hidden_faces.nonzero()[0].tolist())
    assert visit.shown == shown
    assert [one["hidden"] for one in visit.of("shown")[1:]] == [len(faces) for faces in hidden]
    assert visit["hidden_base_faces"] == hidden[-1]
    assert visit["swaps"] == len(walk)
    assert visit["repeated_bytes"] == 0


def test_a_return_is_shown_at_once_and_costs_no_bytes(unity: Unity, server: Service) -> None:
    far = (55, 1, 55, 12)
    url = f"{server.url}/scenes/grid"
    visit = unity.land(url, *steps("land", (5, 1, 5, 12), far, (5, 1, 5, 12)), "wait")
    first, second, third = visit.shown
    assert first == third != second
    order = [event["type"] for event in visit["events"] if event["landing"] == 3]
    assert order == ["shown", "planned", "ready"], "shown before the answer, and not again"
    assert visit.of("planned")[2]["load"] == 0


def test_a_place_that_left_the_graphics_card_comes_from_memory(
    unity: Unity, server: Service
) -> None:
    walk = steps("land", (5, 1, 5, 12), (55, 1, 55, 12), (5, 1, 5, 12))
    visit = unity.land(f"{server.url}/scenes/grid", *walk, spare_bytes=0)
    assert visit.shown[0] == visit.shown[2]
    assert [plan["load"] for plan in visit.of("planned")][2] == 0


def test_memory_is_bounded(unity: Unity, server: Service) -> None:
    walk = steps("land", (5, 1, 5, 3), (55, 1, 55, 3), (5, 1, 55, 3), (5, 1, 5, 3))
    visit = unity.land(f"{server.url}/scenes/grid", *walk, cache_bytes=0, spare_bytes=0)
    assert [len(shown) for shown in visit.shown] == [1, 1, 1, 1]
    assert visit.of("planned")[3]["load"] == 1, "what was let go is sent again"
    assert visit["held_segments"] <= 2


def test_landings_that_are_never_shown_leave_the_graphics_card(
    unity: Unity, server: Service
) -> None:
    walk = steps("land", (5, 1, 5, 3), (55, 1, 55, 12), (5, 1, 55, 3), (30, 1, 5, 3))
    visit = unity.land(f"{server.url}/scenes/grid", *walk, show=0, spare_bytes=0)
    assert (visit.shown, len(visit.of("ready"))) == ([], 4)
    assert visit["uploaded"] == visit.of("planned")[-1]["segments"]


@pytest.mark.parametrize("budget", ["max_triangles", "max_bytes", "max_segments"])
def test_budgets_are_never_exceeded(unity: Unity, server: Service, budget: str) -> None:
    url = f"{server.url}/scenes/grid"
    bound = {"max_triangles": 3000, "max_bytes": 20_000, "max_segments": 10}[budget]
    visit = unity.land(url, EVERYWHERE, **{budget: bound})
    (visible,), _ = land_with_sdk(url, [(30, 1, 30, 100)], **{budget: bound})
    assert visit.shown == [visible]
    (plan,) = visit.of("planned")
    assert (plan["omitted"], plan["omitted_by"]) == (36 - len(visible), budget)
    assert plan["effective_radius_m"] < 100


def test_a_newer_landing_supersedes_the_older(unity: Unity, server: Service) -> None:
    url = f"{server.url}/scenes/big"
    visit = unity.land(url, "start:30,1,30,100", "land:5,1,5,2", credit_bytes=65_536)
    (visible,), _ = land_with_sdk(url, [(5, 1, 5, 2)])
    assert visit.shown == [visible]
    assert visit["payload_bytes"] < visit.of("planned")[0]["load_bytes"] / 2


def test_an_aim_brings_what_the_landing_needs(unity: Unity, server: Service) -> None:
    visit = unity.land(
        f"{server.url}/scenes/grid",
        *("land:5,1,5,3", "aim:30,1,30,12", "pause:800", "land:30,1,30,12"),
    )
    plan = visit.of("planned")[-1]
    assert (plan["load"], plan["segments"] > 3) == (0, True)


def test_picks_are_answered(unity: Unity, server: Service) -> None:
    visit = unity.land(
        f"{server.url}/scenes/grid", "land:5,1,5,3", "pick:5,50,5,0,-1,0", "pick:500,50,5,0,-1,0"
    )
    met, missed = visit["picks"]
    assert met["segment"] == 0
    assert met["position"][0] == pytest.approx(5, abs=1e-6)
    assert met["attributes"]["grade"] == pytest.approx(0.55, abs=0.01)
    assert missed is None


def test_a_refused_landing_is_reported_and_the_next_one_goes_on(
    unity: Unity, server: Service
) -> None:
    visit = unity.land(f"{server.url}/scenes/grid", "land:0,1,0,100000", "land:5,1,5,3")
    assert [one["code"] for one in visit.of("failed")] == ["radius_too_large"]
    assert (visit.failure, len(visit.shown)) == (None, 1)


def test_addresses_in_every_form_that_users_paste(unity: Unity, server: Service) -> None:
    host = server.url.removeprefix("http://")
    for url in (
        f"ws://{host}/scenes/grid/stream",
        f"{server.url}/scenes/grid/",
        f" {server.url}/scenes/grid",
    ):
        assert unity.land(url, "land:5,1,5,3").failure is None, url
    for url, code in {
        server.url: "several_scenes",
        f"http://me:secret@{host}/scenes/grid": "invalid_url",
        f"{server.url}/scenes/grid?token=secret": "invalid_url",
        f"{server.url}/scenes/a/b": "invalid_url",
        host: "invalid_url",
        "http://127.0.0.1:9/scenes/grid": "unreachable",
    }.items():
        failure = unity.land(url, "land:5,1,5,3").failure
        assert failure is not None
        assert failure.startswith(f"{code}: "), failure
        assert "secret" not in failure


def test_a_coarser_level_is_shown_in_a_ring(unity: Unity, server: Service) -> None:
    """To three times the radius; a switch leaves it out, and budgets cut it first."""
    url = f"{server.url}/scenes/levels"
    with terraport.sync.connect(url) as session:
        session.land((30, 1, 30), 6, coarse_radius_m=18).ready()
        shown, hidden = sorted(session.visible), session.hidden_faces.nonzero()[0].tolist()
        count = session.scene.segment_count
    visit = unity.land(url, "land:30,1,30,6", "stand:30,1,30", "stand:44,1,30")
    assert visit.shown == [shown]
    assert visit["hidden_base_faces"] == hidden
    assert min(shown) < count <= max(shown)
    (_, here, _), (_, there, _) = visit["feet"]
    assert here in shown
    assert there + count in shown
    full = [segment for segment in shown if segment < count]
    assert unity.land(url, "land:30,1,30,6", ring=0).shown == [full]
    cut = unity.land(url, "land:30,1,30,6", max_segments=len(shown) - 5)
    assert [segment for segment in cut.shown[0] if segment < count] == full
    assert cut.of("planned")[0]["omitted"] == 5


def test_feet_stand_on_what_is_shown(unity: Unity, server: Service) -> None:
    url = f"{server.url}/scenes/grid"
    ground = shown_by_the_sdk(url)
    walk = places().tolist()
    stands = [f"stand:{x!r},100,{z!r}" for x, z in walk]
    visit = unity.land(url, *steps("land", LANDING), *stands)
    assert len(visit["feet"]) == STEPS
    apart_m, on_detail = [], 0
    for (x, z), foot in zip(walk, visit["feet"], strict=True):
        expected = ground.height_m(x, z)
        assert (foot is None) == (expected is None), (x, z)
        if foot is not None and expected is not None:
            # The ground that is shown, and that is made solid around the feet.
            apart_m += [abs(foot[0] - expected[0]), abs(foot[2] - foot[0])]
            on_detail += foot[1] >= 0
    assert 20 < on_detail < len(apart_m) / 2 - 20, "the walk is on detail, and on the base"
    assert max(apart_m) <= BOUND_M


# ---- faults


def test_a_cut_connection_is_made_again_and_no_byte_comes_twice(
    unity: Unity, server: Service
) -> None:
    with ThreadedProxy(server.url) as line:
        line.proxy.cuts = [600_000, 1_700_000, 500_000]
        visit = unity.land(f"{line.url}/scenes/big", EVERYWHERE, credit_bytes=300_000)
    assert visit.shown == [list(range(36))]
    assert visit["repeated_bytes"] == 0
    assert visit.states == ["connecting", "open"] + ["waiting", "connecting", "open"] * 3


def test_a_flipped_bit_is_found_and_the_segment_asked_for_again(
    unity: Unity, server: Service
) -> None:
    url = f"{server.url}/scenes/big"
    _, meshes = land_with_sdk(url, [(30, 1, 30, 100)])
    with ThreadedProxy(server.url) as line:
        proxy: Any = line.proxy
        proxy.flip_at = 3_000_000
        visit = unity.land(f"{line.url}/scenes/big", EVERYWHERE)
        assert proxy.flip_at is None, "it was flipped"
    assert visit.shown == [list(range(36))]
    assert {int(key): value for key, value in visit["segments"].items()} == {
        segment: digests(mesh) for segment, mesh in meshes.items()
    }


def test_a_segment_that_the_service_cannot_read_is_missing(unity: Unity, tmp_path: Path) -> None:
    own = write_grid_scene(tmp_path / "scenes" / "own")
    with Scene.open(own.path) as scene:
        offset = int(scene.index.offset[14]) + 40
        pack = scene.file_path("segments.pack")
    damaged = bytearray(pack.read_bytes())
    damaged[offset] ^= 0x10
    pack.write_bytes(damaged)
    with Service(own.path.parent) as service:
        visit = unity.land(f"{service.url}/scenes/own", EVERYWHERE)
    assert visit.of("ready")[0]["missing"] == [14]
    assert visit.shown == [[segment for segment in range(36) if segment != 14]]


def test_a_landing_with_too_much_that_cannot_be_decoded_is_given_up(
    unity: Unity, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The service finds nothing wrong with them: they are what the index says."""

    class Unreadable(SceneWriter):
        def add_segment(self, payload: bytes, **facts: Any) -> int:
            facts["texture"] = (0, 0, 0)
            return super().add_segment(gzip.compress(b"no segment" + payload), **facts)

    monkeypatch.setattr(grid_scene, "SceneWriter", Unreadable)
    monkeypatch.setattr(grid_scene, "SIDE", 9)
    write_grid_scene(tmp_path / "scenes" / "own")
    with Service(tmp_path / "scenes") as service:
        visit = unity.land(f"{service.url}/scenes/own", EVERYWHERE, "land:5,1,5,3", timeout_s=20)
    assert [one["code"] for one in visit.of("failed")] == ["damaged"]
    assert [plan["segments"] for plan in visit.of("planned")[:2]] == [81, 81]
    # Where fewer are needed, they are left out.
    assert (visit.failure, visit.shown) == (None, [[]])
    assert [ready["missing"] for ready in visit.of("ready")] == [[0]]


def test_a_service_that_is_killed_and_comes_back(unity: Unity, tmp_path: Path) -> None:
    write_grid_scene(tmp_path / "scenes" / "big", cells=80)
    with Service(tmp_path / "scenes") as first, ThreadedProxy(first.url) as line:
        line.proxy.bytes_per_s = 4_000_000

        def restart() -> None:
            while line.proxy.down_bytes < 2_000_000:
                time.sleep(0.01)
            first.kill()
            time.sleep(0.5)
            first.start()

        thread = threading.Thread(target=restart)
        thread.start()
        visit = unity.land(f"{line.url}/scenes/big", EVERYWHERE, credit_bytes=300_000)
        thread.join()
    assert visit.shown == [list(range(36))]
    assert visit["repeated_bytes"] == 0
    assert visit["connections"] == 2


def test_a_deadline_shows_the_inner_part_first(unity: Unity, server: Service) -> None:
    with ThreadedProxy(server.url) as line:
        line.proxy.bytes_per_s = 1_200_000
        visit = unity.land(
            f"{line.url}/scenes/big", "land:30,1,30,100,15,1500", credit_bytes=300_000
        )
    inner, whole = visit.of("shown")[1:]
    assert (inner["degraded"], whole["degraded"]) == (True, False)
    assert 0 < len(inner["segments"]) < len(whole["segments"]) == 36
    assert inner["hidden"] < whole["hidden"]


# ---- disk


def kept(folder: Path) -> list[Path]:
    return sorted(folder.glob("*/*.segment-2"))


def test_a_second_run_reads_from_disk(unity: Unity, server: Service, tmp_path: Path) -> None:
    url, landing = f"{server.url}/scenes/grid", "land:30,1,30,9"
    first = unity.land(url, landing, "pause:500", disk=tmp_path)
    assert len(kept(tmp_path)) == len(first.shown[0])
    second = unity.land(url, landing, disk=tmp_path)
    assert (second["payload_bytes"], second["segments"]) == (0, first["segments"])
    # Damaged, it is loaded again and kept again.
    damaged = kept(tmp_path)[3]
    data = damaged.read_bytes()
    damaged.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    third = unity.land(url, landing, "pause:500", disk=tmp_path)
    assert (third["payload_bytes"], third["segments"]) == (len(data), first["segments"])
    assert damaged.read_bytes() == data


def test_what_memory_let_go_before_its_upload_is_read_from_disk_again(
    unity: Unity, server: Service, tmp_path: Path
) -> None:
    """As while the base is being uploaded: then no segment is."""
    url, (here, there) = f"{server.url}/scenes/grid", ("5,1,5,3", "55,1,55,3")
    unity.land(url, f"land:{here}", f"land:{there}", "pause:500", disk=tmp_path)
    waiting = ("base:0", f"start:{here}", "pause:500", f"start:{there}", "pause:500")
    visit = unity.land(
        url,
        *(*waiting, f"start:{here}", "base:1", "wait"),
        disk=tmp_path,
        cache_bytes=0,
        timeout_s=20,
    )
    assert (visit.failure, visit.shown, visit["payload_bytes"]) == (None, [[0]], 0)
    assert len(visit.of("ready")) == 3


def test_the_disk_is_bounded_and_need_not_be_there(
    unity: Unity, server: Service, tmp_path: Path
) -> None:
    url, landing = f"{server.url}/scenes/grid", "land:30,1,30,9"
    first = unity.land(url, landing, "pause:500", disk=tmp_path / "bounded", disk_bytes=8_000)
    assert first["payload_bytes"] > 8_000
    assert 0 < sum(path.stat().st_size for path in kept(tmp_path / "bounded")) <= 8_000
    blocked = tmp_path / "file"
    blocked.write_text("a file where the folder should be")
    assert unity.land(url, landing, "pause:300", disk=blocked)["segments"] == first["segments"]
    assert blocked.read_text() == "a file where the folder should be"


# ---- tokens


def test_a_token_opens_and_a_refused_one_is_not_repeated(unity: Unity, guarded: Service) -> None:
    url = f"{guarded.url}/scenes/grid"
    assert unity.land(url, "land:5,1,5,3", token=TOKEN).failure is None
    for options in ({}, {"token": "not-the-right-token"}):
        visit = unity.land(url, "land:5,1,5,3", **options)
        assert visit.failure is not None
        assert visit.failure.startswith("unauthorised: ")
        assert TOKEN not in visit.output
    missing = unity.land(f"{guarded.url}/scenes/none", "land:5,1,5,3", token=TOKEN)
    assert missing.failure is not None
    assert missing.failure.startswith("unknown_scene: ")


@contextmanager
def renewed(path: Path, valid_s: float) -> Iterator[None]:
    """A file with a token that is replaced twice a second."""
    stopped = threading.Event()

    def write() -> None:
        expires_s = int(time.time() + valid_s)
        token = make_token(KEY, name="anna", scenes=frozenset({"grid"}), expires_s=expires_s)
        path.with_suffix(".new").write_text(token)
        path.with_suffix(".new").replace(path)

    def run() -> None:
        while not stopped.wait(0.5):
            write()

    write()
    thread = threading.Thread(target=run)
    thread.start()
    yield
    stopped.set()
    thread.join()


def test_a_session_outlives_its_tokens(unity: Unity, scenes: Path, tmp_path: Path) -> None:
    write_keys(tmp_path / "keys", [KEY.line()])
    settings: dict[str, Any] = {"token_leeway_s": 0.0, "access_check_s": 0.1}
    land = steps("land", HERE)
    with (
        BackgroundServer(scenes, token_keys_file=tmp_path / "keys", **settings) as server,
        renewed(tmp_path / "token", 3),
    ):
        url = server.scene_url("grid")
        walk = (*land, "pause:5500", *land, "wait")
        visit = unity.land(url, *walk, token_file=tmp_path / "token")
    assert visit.failure is None
    assert visit.of("planned")[-1]["load"] == 0
    assert visit.states[:5] == ["connecting", "open", "waiting", "connecting", "open"]
    refused = next(one for one in visit.of("link") if one["state"] == "waiting")
    assert (refused["code"], refused["close_code"]) == ("unauthorised", 4401)


# ---- groups


def beside(work: Callable[[], Any], run: Callable[[], Visit]) -> tuple[Any, Visit]:
    """Run a program while something else happens; return the results of both."""
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(work)
        visit = run()
        return other.result(WAIT_S), visit


@pytest.mark.parametrize("follows", [True, False])
def test_a_member_lands_where_the_guide_does(unity: Unity, server: Service, follows: bool) -> None:
    url, name = f"{server.url}/scenes/grid", f"led-{follows}"

    def lead() -> tuple[Any, list[int]]:
        with terraport.sync.connect(url) as session:
            group = session.join_group(name, role="guide", name="Ada")
            group.members_present(2, timeout_s=WAIT_S)
            there = group.land_group(HERE[:3], HERE[3])
            there.land().ready()
            return there.all_there(timeout_s=WAIT_S), sorted(session.visible)

    (arrivals, visible), visit = beside(
        lead,
        lambda: unity.land(url, f"follow:{int(follows)}", f"join:{name},member,Bo", "barrier:1"),
    )
    own = visit.of("group_joined")[0]["member"]
    assert own in (arrivals.ready if follows else arrivals.missing)
    assert visit["visible"] == (visible if follows else [])
    (called,) = visit.of("group_called")
    assert [*called["gathering"]["position"], called["gathering"]["radius_m"]] == list(HERE)


def test_a_guide_takes_the_sdk_along(unity: Unity, server: Service) -> None:
    url = f"{server.url}/scenes/grid"

    def follow() -> tuple[list[int], tuple[float, ...]]:
        with terraport.sync.connect(url) as session:
            group = session.join_group("leading")
            call = next(iter(group))
            call.land().ready()
            return list(call.all_there(timeout_s=WAIT_S).ready), (*call.position, call.radius_m)

    guide = ("join:leading,guide", "people:2", *steps("gather", HERE), "barrier:1")
    (ready, place), visit = beside(follow, lambda: unity.land(url, *guide))
    assert place == HERE
    assert sorted(visit.of("group_gathered")[0]["gathering"]["ready"]) == sorted(ready)
    assert len(ready) == 2


def test_a_seat_outlives_a_cut_connection(unity: Unity, server: Service) -> None:
    with ThreadedProxy(server.url) as line:

        def lead() -> list[int]:
            with terraport.sync.connect(f"{server.url}/scenes/grid") as session:
                group = session.join_group("cut", role="guide")
                group.members_present(2, timeout_s=WAIT_S)
                for number, place in enumerate((THERE, HERE)):
                    if number:
                        line.cut()
                    there = group.land_group(place[:3], place[3])
                    there.land().ready()
                    ready = list(there.all_there(timeout_s=WAIT_S).ready)
                return ready

        ready, visit = beside(
            lead, lambda: unity.land(f"{line.url}/scenes/grid", "join:cut,member", "barrier:2")
        )
    seats = [joined["member"] for joined in visit.of("group_joined")]
    assert len(seats) == 2
    assert len(set(seats)) == 1
    assert seats[0] in ready


def test_what_a_group_does_not_allow_is_refused(unity: Unity, server: Service) -> None:
    url = f"{server.url}/scenes/grid"
    with terraport.sync.connect(url) as session:
        session.join_group("taken", role="guide")
        second = unity.land(url, "join:taken,guide")
        member = unity.land(url, "join:taken,member", *steps("gather", HERE))
    assert second.failure == "join:taken,guide: refused: group_refused"
    assert member.failure == f"{steps('gather', HERE)[0]}: refused: group_refused"
