"""Both cores land on the real service, and assemble what the Python SDK assembles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engines.conftest import TOKEN
from engines.programs import Client
from engines.sdk_arrays import NORMAL_STEP, digests, land_with_sdk, normals_apart
from faults.service import Service

import terraport.sync
from terraport_payload import SegmentMesh, box_distances_m
from terraport_store import Scene

HERE = "30,1,30"
EVERYWHERE = "land:30,1,30,100"


def same_arrays(landed: dict[int, dict[str, Any]], meshes: dict[int, SegmentMesh]) -> None:
    """Array for array, bit for bit; of the normals see `normals_apart`."""
    assert set(landed) == set(meshes)
    for segment, mesh in meshes.items():
        assert landed[segment] == digests(mesh), f"segment {segment}"


@pytest.mark.parametrize("threaded", [0, 1], ids=["pumped", "threaded"])
def test_assembled_segments_are_those_of_the_python_sdk(
    client: Client, server: Service, threaded: int, tmp_path: Path
) -> None:
    url = f"{server.url}/scenes/grid"
    (visible,), meshes = land_with_sdk(url, [(30, 1, 30, 22)])
    landed = client.land(
        url,
        f"land:{HERE},22",
        threaded=threaded,
        dump=tmp_path,
    )
    assert (landed.exit_code, landed.failure) == (0, None), landed.output
    (ready,) = landed.landings
    assert ready["visible"] == visible
    assert 4 < len(visible) < 36
    assert ready["missing"] == []
    same_arrays(landed.segments, meshes)
    assert normals_apart(meshes, tmp_path) <= NORMAL_STEP
    (plan,) = landed.of("planned")
    assert plan["load_bytes"] == sum(entry["length"] for entry in plan["load"])
    assert ready["payload_bytes"] == plan["load_bytes"] == landed.stats["payload_bytes"]
    assert [event["facts"] for event in landed.of("arrived")] == plan["load"], "nearest first"
    assert [event["state"] for event in landed.of("link")][:2] == ["connecting", "open"]


def test_a_scene_of_two_levels_is_landed_in_at_full_detail(
    client: Client, server: Service, tmp_path: Path
) -> None:
    """A stream asks for no ring by itself: what it brings is what a scene of one level has."""
    walk = [(5, 1, 5, 12), (55, 1, 55, 30), (5, 1, 5, 12)]
    visible, meshes = land_with_sdk(f"{server.url}/scenes/grid", walk)
    orders = [f"land:{x},{y},{z},{radius}" for x, y, z, radius in walk]
    landed = client.land(f"{server.url}/scenes/levels", *orders, dump=tmp_path)
    assert (landed.exit_code, landed.failure) == (0, None), landed.output
    assert [ready["visible"] for ready in landed.landings] == visible
    assert max(max(shown) for shown in visible) < 36
    same_arrays({segment: landed.segments[segment] for segment in visible[-1]}, meshes)
    assert landed.landings[2]["payload_bytes"] == 0


def test_a_scene_of_two_levels_is_drawn_with_a_ring(client: Client, server: Service) -> None:
    """Through the stage, which asks for it: what is shown and hidden is what the SDK says."""
    url = f"{server.url}/scenes/levels"
    places = [(30.0, 1.0, 30.0, 6.0), (12.0, 1.0, 44.0, 8.0), (30.0, 1.0, 30.0, 6.0)]
    orders = [f"land:{x},{y},{z},{radius}" for x, y, z, radius in places]
    with terraport.sync.connect(url) as session:
        count = session.scene.segment_count
        shown, hidden, loaded = [], [], []
        for x, y, z, radius_m in places:
            landing = session.land((x, y, z), radius_m, coarse_radius_m=3 * radius_m)
            landing.ready()
            shown.append(sorted(session.visible))
            hidden.append(session.hidden_faces.nonzero()[0].tolist())
            loaded.append(landing.plan.load["id"].tolist())
    for number in range(1, len(places) + 1):
        landed = client.land(url, *orders[:number], staged=1)
        assert (landed.exit_code, landed.failure) == (0, None), landed.output
        assert landed.stage["faults"] == []
        assert landed.stage["swaps"] == number
        assert landed.stage["visible"] == shown[number - 1]
        assert landed.stage["hidden_base_faces"] == hidden[number - 1]
        assert min(shown[number - 1]) < count <= max(shown[number - 1]), "both levels"
    plans = landed.of("planned")
    assert [[row["id"] for row in plan["load"]] for plan in plans] == loaded
    assert loaded[2] == [], "the way back sends nothing"
    for plan, (*_, radius_m) in zip(plans, places, strict=True):
        assert plan["effective_radius_m"] == radius_m
        assert plan["coarse_radius_m"] == 3 * radius_m


def test_an_aim_brings_the_ring_and_a_pick_there_tells_its_segment(
    client: Client, server: Service
) -> None:
    """Nothing is left to the landing; feet in the ring stand on the segment's coarser level."""
    url = f"{server.url}/scenes/levels"
    with terraport.sync.connect(url) as session:
        session.land((30, 1, 30), 6, coarse_radius_m=18).ready()
        count, visible = session.scene.segment_count, sorted(session.visible)
    landed = client.land(
        url, "aim:30,1,30,6", "land:30,1,30,6", "stand:30,1,30", "stand:44,1,30", staged=1
    )
    assert (landed.exit_code, landed.failure) == (0, None), landed.output
    assert landed.of("planned")[0]["load"] == []
    assert landed.stats["aim_hits"] == 1
    (_, here, _), (_, there, _) = landed.stage["feet"]
    assert here in visible, "full detail"
    assert there not in visible
    assert there + count in visible, "the coarser level"


def test_budgets_count_both_levels_and_the_ring_gives_way(client: Client, server: Service) -> None:
    """Nearest first: a bound of segments leaves full detail, and less of the ring."""
    url = f"{server.url}/scenes/levels"
    free = client.land(url, "land:30,1,30,6", staged=1)
    most = len(free.stage["visible"]) - 5
    landed = client.land(url, "land:30,1,30,6", staged=1, max_segments=most)
    assert (landed.exit_code, landed.failure) == (0, None), landed.output
    assert len(landed.stage["visible"]) == most
    full = [segment for segment in free.stage["visible"] if segment < 36]
    assert [segment for segment in landed.stage["visible"] if segment < 36] == full
    plan = landed.of("planned")[0]
    assert plan["omitted_segments"] == 5
    assert 6 < plan["coarse_radius_m"] < 18


@pytest.mark.parametrize("scene", ["axes", "tiny"])
def test_textures_colours_and_attributes_are_those_of_the_python_sdk(
    client: Client, server: Service, scene: str, tmp_path: Path
) -> None:
    url = f"{server.url}/scenes/{scene}"
    _, meshes = land_with_sdk(url, [(0, 1, 0, 50)])
    landed = client.land(url, "land:0,1,0,50", dump=tmp_path)
    assert landed.exit_code == 0, landed.output
    same_arrays(landed.segments, meshes)
    normals_apart(meshes, tmp_path)
    assert any(mesh.texture is not None for mesh in meshes.values()) == (scene == "axes")


def test_visible_sets_of_a_walk_are_those_of_the_python_sdk(
    client: Client, server: Service, scenes: Path
) -> None:
    """That is what lies within each radius, by brute force, whatever the way that led there."""
    url = f"{server.url}/scenes/grid"
    walk = [(5.0 * step, 1.0, 7.0 * step % 55, 6.0 + step * 5 % 23) for step in range(12)]
    visible, _ = land_with_sdk(url, walk)
    landed = client.land(url, *(f"land:{x},{y},{z},{radius}" for x, y, z, radius in walk))
    assert [ready["visible"] for ready in landed.landings] == visible
    with Scene.open(scenes / "grid") as scene:
        bounds = scene.index.bounds
    for shown, (*position, radius_m) in zip(visible, walk, strict=True):
        assert shown == np.flatnonzero(box_distances_m(bounds, position) <= radius_m).tolist()
    assert any(plan["nearby"] for plan in landed.of("planned")), "or there is nothing to tell apart"
    assert landed.stats["repeated_bytes"] == 0


def test_a_second_visit_costs_no_bytes(client: Client, server: Service) -> None:
    landed = client.land(
        f"{server.url}/scenes/grid", "land:5,1,5,12", "land:55,1,55,12", "land:5,1,5,12"
    )
    first, second, third = landed.landings
    assert first["visible"] == third["visible"] != second["visible"]
    assert (third["payload_bytes"], landed.of("planned")[2]["load"]) == (0, [])
    assert landed.stats["repeated_bytes"] == 0


@pytest.mark.parametrize("budget", ["max_triangles", "max_bytes", "max_segments"])
def test_budgets_are_never_exceeded(client: Client, server: Service, budget: str) -> None:
    url = f"{server.url}/scenes/grid"
    (whole,) = client.land(url, EVERYWHERE).of("planned")
    sums = {
        "max_triangles": [row["faces"] for row in whole["load"]],
        "max_bytes": [row["length"] for row in whole["load"]],
        "max_segments": [1] * len(whole["load"]),
    }[budget]
    bound = sum(sums[:10]) + (sums[10] - 1 if budget != "max_segments" else 0)
    landed = client.land(url, EVERYWHERE, **{budget: bound})
    (plan,), (ready,) = landed.of("planned"), landed.landings
    assert plan["load"] == whole["load"][:10]
    assert plan["omitted_by"] == budget
    assert plan["omitted_segments"] == 26
    assert plan["effective_radius_m"] < 100
    assert ready["visible"] == sorted(row["id"] for row in plan["load"])
    (visible,), _ = land_with_sdk(url, [(30, 1, 30, 100)], **{budget: bound})
    assert ready["visible"] == visible


def test_a_newer_landing_supersedes_the_older(client: Client, server: Service) -> None:
    url = f"{server.url}/scenes/big"
    landed = client.land(url, "start:30,1,30,100", "land:5,1,5,2", credit_bytes=65_536)
    assert landed.exit_code == 0, landed.output
    (superseded,) = landed.of("superseded")
    (ready,) = landed.landings
    assert superseded["by"] == ready["landing"] > superseded["landing"]
    (visible,), _ = land_with_sdk(url, [(5, 1, 5, 2)])
    assert ready["visible"] == visible
    total = sum(row["length"] for row in landed.of("planned")[0]["load"])
    assert landed.stats["payload_bytes"] < total / 2, "the rest of the first was never sent"


def test_the_cache_keeps_its_bound_and_says_what_it_let_go(client: Client, server: Service) -> None:
    url = f"{server.url}/scenes/grid"
    landed = client.land(
        url, "land:5,1,5,3", "land:55,1,55,3", "land:5,1,55,3", "land:5,1,5,3", cache_bytes=0
    )
    first, *_, last = landed.landings
    assert [len(ready["visible"]) for ready in landed.landings] == [1, 1, 1, 1]
    dropped = [segment for event in landed.of("dropped") for segment in event["segments"]]
    assert set(first["visible"]) <= set(dropped)
    assert last["payload_bytes"] == first["payload_bytes"] > 0, "what was let go is sent again"
    assert landed.stats["held_segments"] <= 2


def test_an_aim_brings_what_the_landing_needs(client: Client, server: Service) -> None:
    landed = client.land(
        f"{server.url}/scenes/grid", "land:5,1,5,3", "aim:30,1,30,12", "land:30,1,30,12"
    )
    plan = landed.of("planned")[-1]
    assert plan["load"] == []
    assert len(plan["keep"]) > 3
    assert landed.stats["aimed_landings"] == landed.stats["aim_hits"] == 1
    assert landed.stats["prefetched_bytes"] == landed.stats["used_prefetched_bytes"] > 0


def test_picks_are_answered(client: Client, server: Service) -> None:
    landed = client.land(
        f"{server.url}/scenes/grid", "land:5,1,5,3", "pick:5,50,5,0,-1,0", "pick:500,50,5,0,-1,0"
    )
    met, missed = landed.picks
    assert met["hit"]["segment"] == 0
    x, y, z = met["hit"]["position"]
    assert abs(x - 5) < 1e-6
    assert 0 <= y <= 2
    assert abs(z - 5) < 1e-6
    assert met["hit"]["attributes"]["grade"] == pytest.approx(0.55, abs=0.01)
    assert missed["hit"] is None


def test_a_landing_that_cannot_be_is_refused_and_the_next_one_goes_on(
    client: Client, server: Service
) -> None:
    landed = client.land(f"{server.url}/scenes/grid", "land:0,1,0,100000", "land:5,1,5,3")
    (refused,) = landed.of("refused")
    assert (refused["code"], refused["fatal"], refused["landing"]) == ("radius_too_large", False, 1)
    assert (landed.failure, len(landed.landings)) == (None, 1)


def test_a_token_opens_a_wrong_one_is_told_once_and_a_right_one_mends_it(
    client: Client, guarded: Service
) -> None:
    url = f"{guarded.url}/scenes/grid"
    assert client.land(url, "land:5,1,5,3", token=TOKEN).exit_code == 0
    for options in ({}, {"token": "not-the-right-token"}):
        landed = client.land(url, "land:5,1,5,3", "pause:700", **options)
        assert landed.failure == "land:5,1,5,3: closed: unauthorised"
        states = [link["state"] for link in landed.of("link")]
        assert states == ["connecting", "closed"], "a refused token is not repeated"
        assert landed.of("link")[-1]["close_code"] == 4401
        assert TOKEN not in landed.output
    mended = client.land(
        url, "land:5,1,5,3", f"reconnect:{TOKEN}", "wait", token="not-the-right-token"
    )
    assert (mended.failure, len(mended.landings)) == (None, 1)


def test_an_unknown_scene_is_told_and_not_asked_for_again(client: Client, server: Service) -> None:
    landed = client.land(f"{server.url}/scenes/no-such-scene", "land:5,1,5,3", "pause:700")
    assert landed.failure == "land:5,1,5,3: closed: unknown_scene"
    assert [link["state"] for link in landed.of("link")] == ["connecting", "closed"]


def test_what_an_engine_would_draw_is_what_the_python_sdk_shows(
    client: Client, server: Service
) -> None:
    """Through the stage: decoded, uploaded in slices, and swapped in one frame; base faces too."""
    url = f"{server.url}/scenes/grid"
    places = [(30.0, 1.0, 30.0, 22.0), (12.0, 1.0, 44.0, 15.0), (30.0, 1.0, 30.0, 8.0)]
    with terraport.sync.connect(url) as session:
        base = session.base()
        for number, (x, y, z, radius_m) in enumerate(places, 1):
            session.land((x, y, z), radius_m).ready()
            steps = [f"land:{a},{b},{c},{d}" for a, b, c, d in places[:number]]
            landed = client.land(url, *steps, staged=1)
            assert landed.exit_code == 0, landed.output
            assert landed.stage["faults"] == []
            assert landed.stage["swaps"] == number
            assert landed.stage["visible"] == sorted(session.visible)
            hidden = session.hidden_faces.nonzero()[0].tolist()
            assert landed.stage["hidden_base_faces"] == hidden
            assert 0 < len(hidden) < len(base.mesh.faces)
