"""Landings in Godot itself: land, hop, return, a cut line, a newer landing, what it left freed."""

from __future__ import annotations

import json
import re
import shutil
import time
from pathlib import Path

import pytest
from engines.programs import ThreadedProxy
from faults.service import Service
from godot.engine import Engine, Visit

import terraport.sync
from terraport_pipeline.demo_scenes import SHIPPED_ID, shipped_scene

HERE = (30.0, 1.0, 30.0, 22.0)
THERE = (12.0, 1.0, 44.0, 15.0)
NEAR = (30.0, 1.0, 30.0, 8.0)


def is_clean(visit: Visit) -> None:
    """Nothing failed, and the engine complained of nothing."""
    assert visit.failure == ""
    complaints = re.findall(r"^.*(?:ERROR|WARNING|leaked).*$", visit.output, re.MULTILINE)
    assert complaints == [], visit.output[-4000:]


def test_a_landing_a_hop_and_a_return(godot: Engine, server: Service) -> None:
    """What is drawn is what the Python SDK shows, base faces too, and a return costs no byte."""
    url = f"{server.url}/scenes/grid"
    places = [HERE, THERE, NEAR, HERE]
    visit = godot.visit(url, *(["land", *place] for place in places))
    is_clean(visit)
    with terraport.sync.connect(url) as session:
        base = session.base()
        for landed, (x, y, z, radius_m) in zip(visit.results, places, strict=True):
            session.land((x, y, z), radius_m).ready()
            assert landed["visible"] == sorted(session.visible)
            hidden = int(session.hidden_faces.sum())
            segments, _, faces, _ = landed["digest"].split(":")
            assert (int(segments), int(faces)) == (len(session.visible), hidden)
            assert 0 < hidden < len(base.mesh.faces)
            assert landed["swaps"] == 1, "everything changes in one frame"
    first, *_, last = visit.results
    assert first["digest"] == last["digest"]
    assert last["status"]["payload_bytes"] == 0
    assert last["stats"]["repeated_bytes"] == 0
    assert [link["state"] for link in visit.of("link_changed")] == ["connecting", "open"]


def test_a_ring_of_the_coarser_level_comes_and_can_be_left_out(
    godot: Engine, server: Service
) -> None:
    """With and without: the ids that the Python SDK shows, and the base's faces that it hides."""
    url = f"{server.url}/scenes/levels"
    x, y, z, radius_m = NEAR
    ray = ["cast", [[x + 2 * radius_m, 100.0, z, 0.0, -1.0, 0.0]]]
    with_ring = godot.visit(url, ["land", *THERE], ["land", *NEAR], ray)
    without = godot.visit(url, ["land", *NEAR], ray, shows_coarse=False)
    is_clean(with_ring)
    is_clean(without)
    with terraport.sync.connect(url) as session:
        count = session.scene.segment_count
        for visit, ring_m in ((with_ring, 3 * radius_m), (without, None)):
            session.land((x, y, z), radius_m, coarse_radius_m=ring_m).ready()
            *_, landed, (met,) = visit.results
            assert landed["visible"] == sorted(session.visible)
            assert (max(landed["visible"]) >= count) == (ring_m is not None)
            hidden = int(session.hidden_faces.sum())
            assert landed["digest"].split(":")[2] == str(hidden)
            planned = visit.of("planned")[-1]
            assert (planned["effective_radius_m"], planned["coarse_radius_m"]) == (
                radius_m,
                ring_m or 0,
            )
            assert (met[3] in range(count)) == (ring_m is not None), "never another id"


def test_what_a_landing_left_is_freed(godot: Engine, server: Service) -> None:
    """With no room for spare meshes the engine keeps those that are drawn, and no more."""
    url = f"{server.url}/scenes/big"
    hops = [["land", 5.0 + 50.0 * (hop % 2), 1.0, 30.0, 12.0] for hop in range(6)]
    visit = godot.visit(url, *hops, ["pause", 500], ["stats"], device=2, spare_mesh_mib=1)
    is_clean(visit)
    *landed, _, stats = visit.results
    shown = len(landed[-1]["visible"])
    met = set().union(*(step["visible"] for step in landed))
    assert stats["segments"] < len(met), "some were given back"
    blocks = 1
    assert stats["meshes"] == stats["segments"] + blocks
    assert stats["visible_segments"] == shown
    assert stats["gpu_bytes"] - 2**20 < landed[-1]["stats"]["gpu_bytes"]


def test_a_newer_landing_supersedes_the_older(godot: Engine, server: Service) -> None:
    visit = godot.visit(f"{server.url}/scenes/big", ["start", 30, 1, 30, 100], ["land", 5, 1, 5, 2])
    is_clean(visit)
    (superseded,) = visit.of("superseded")
    (shown,) = visit.of("shown")
    assert superseded["by"] == shown["landing"] > superseded["landing"]
    assert visit.results[-1]["visible"] == [0]


def test_a_cut_line_is_mended(godot: Engine, server: Service) -> None:
    """Cut twice in the middle of a landing: it is shown whole, and nothing comes twice."""
    with ThreadedProxy(server.url) as line:
        line.proxy.bytes_per_s = 4e6

        def cut_twice() -> None:
            for sent in (1_000_000, 2_500_000):
                end_s = time.monotonic() + 60
                while line.proxy.down_bytes < sent and time.monotonic() < end_s:
                    time.sleep(0.01)
                line.cut()

        visit = godot.visit(f"{line.url}/scenes/big", ["land", 30, 1, 30, 100], meanwhile=cut_twice)
    is_clean(visit)
    (landed,) = visit.results
    assert landed["visible"] == list(range(36))
    assert landed["stats"]["repeated_bytes"] == 0
    states = [link["state"] for link in visit.of("link_changed")]
    assert states == ["connecting", "open"] + ["waiting", "connecting", "open"] * 2


def test_a_token_opens_and_a_wrong_one_is_told_once(godot: Engine, scenes: Path) -> None:
    token = "a-token-that-is-long-enough"
    with Service(scenes, token=token) as guarded:
        url = f"{guarded.url}/scenes/grid"
        assert godot.visit(url, ["land", *HERE], token=token).failure == ""
        refused = godot.visit(url, token="not-the-right-token")
    (failed,) = refused.of("failed")
    assert (failed["code"], failed["final"]) == ("unauthorised", True)
    assert token not in refused.output


def test_aims_picks_and_rays(godot: Engine, server: Service) -> None:
    """An aim makes the landing free; rays and the engine's physics meet what is shown."""
    spots = ((3.0, 3.0), (21.0, 30.0), (30.5, 30.0), (39.0, 30.0), (57.0, 57.0))
    rays = [[x, 100.0, z, 0.0, -1.0, 0.0] for x, z in spots]
    visit = godot.visit(
        f"{server.url}/scenes/grid",
        ["land", 5, 1, 5, 3],
        ["aim", *HERE],
        ["land", *HERE],
        ["pick", 30.5, 50, 30],
        ["cast", rays],
        ["collide", rays],
        collider_radius_m=15.0,
    )
    is_clean(visit)
    _, aimed, landed, picked, hits, collided = visit.results
    assert aimed["segments"] > 0
    assert landed["status"]["payload_bytes"] == 0
    assert picked["hit"]
    assert picked["position"][1] == pytest.approx(hits[2][1], abs=0.01)
    assert picked["attributes"]["grade"] == pytest.approx(0.5 + 30.5 / 100, abs=0.01)
    assert [hit[3] >= 0 for hit in hits] == [False, True, True, True, False], "detail, and base"
    assert 0 < collided["shapes"] < 25
    for hit, other in zip(hits[1:4], collided["hits"][1:4], strict=True):
        assert other[1] == pytest.approx(hit[1], abs=0.001)


def test_a_group_goes_together(godot: Engine, server: Service) -> None:
    """Godot follows a guide of the Python SDK; then it guides another group itself."""
    url = f"{server.url}/scenes/grid"
    told: dict[str, list[int]] = {}

    def lead() -> None:
        with terraport.sync.connect(url) as session:
            group = session.join_group("tour", role="guide", name="Ada")
            group.members_present(2, timeout_s=120)
            there = group.land_group(HERE[:3], HERE[3])
            there.land().ready()
            told["followed"] = sorted(there.all_there(timeout_s=120).ready)
            told["visible"] = sorted(session.visible)

    visit = godot.visit(
        url,
        ["join", "tour", False, "Bo"],
        ["people", 2],
        ["there", 1],
        ["join", "walk", True, ""],
        ["gather", *THERE],
        meanwhile=lead,
    )
    is_clean(visit)
    seat, people, followed, own, gathered = visit.results
    number = seat["member"]
    assert [(one["name"], one["role"]) for one in people["members"]] in (
        [("Ada", "guide"), ("Bo", "member")],
        [("Bo", "member"), ("Ada", "guide")],
    )
    assert number in told["followed"]
    assert len(told["followed"]) == 2
    assert followed["visible"] == told["visible"]
    assert gathered["group"]["ready"] == [own["member"]]
    called = visit.of("group_called")
    assert [facts["radius_m"] for facts in called] == [HERE[3], THERE[3]]
    assert called[1]["position"] == pytest.approx(THERE[:3])


def test_places_and_pieces_are_those_of_the_python_sdk(godot: Engine, tmp_path: Path) -> None:
    """Regions that people have named are places to land at."""
    scene = tmp_path / SHIPPED_ID
    shutil.copytree(shipped_scene(), scene)
    (regions,) = scene.glob("v-*/regions.json")
    label = {
        "stable_id": json.loads(regions.read_text())["regions"][0]["stable_id"],
        "label": "Grube",
    }
    (scene / "labels.json").write_text(
        json.dumps({"format": "terraport-labels", "format_version": "1.0", "labels": [label]})
    )
    with Service(tmp_path) as service:
        url = f"{service.url}/scenes/{SHIPPED_ID}"
        visit = godot.visit(url, ["places", 0])
        with terraport.sync.connect(url) as session:
            expected = session.places()
            pieces = session.coarser(0)
    is_clean(visit)
    (found,) = visit.results
    assert [place[:2] for place in found["places"]] == [["Grube", 0]]
    assert [place[0] for place in found["places"]] == [place.label for place in expected]
    for place, other in zip(found["places"], expected, strict=True):
        assert place[2:5] == pytest.approx(other.position, abs=0.01)
        assert place[5] == pytest.approx(other.radius_m)
    assert found["landing"] > 0
    assert found["nowhere"] == -1
    assert found["pieces"] == [
        [p.cost, list(p.regions), pytest.approx(p.area_m2), p.label] for p in pieces
    ]


@pytest.mark.parametrize("example", ["first_landing", "first_landing_xr"])
def test_the_examples_land_and_teleport(
    godot: Engine, server: Service, example: str, tmp_path: Path
) -> None:
    """Without a line of code; the ground is swapped and the feet are moved in one frame."""
    out = tmp_path / "out.json"
    output = godot.run(
        ["-s", "res://tests/example.gd"],
        {
            "TERRAPORT_EXAMPLE": f"res://example/{example}.tscn",
            "TERRAPORT_URL": f"{server.url}/scenes/grid",
            "TERRAPORT_OUT": str(out),
        },
    )
    assert re.findall(r"^.*(?:ERROR|WARNING|leaked).*$", output, re.MULTILINE) == [], output[-4000:]
    told = json.loads(out.read_text())
    assert (told["stayed"], told["auto_show"]) == ([], True)
    assert told["first"] != told["second"] != []
    x, y, z = told["head"]
    assert (x, z) == pytest.approx((42.0, 17.0), abs=0.01)
    assert y - told["ground_m"] == pytest.approx(1.7, abs=0.01)
    assert {name for name, _ in told["frames"]} == {"shown", "teleported"}
    frames = [frame for _, frame in told["frames"]]
    assert max(frames) - min(frames) <= 1
    assert ("no headset was found" in output) == example.endswith("xr")
