"""The Godot addon in Godot 4.6 itself: corpora, landings on the real service, pictures."""

from __future__ import annotations

import base64
import gzip
import itertools
import json
import random
import shutil
import struct
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from browser.driven_viewer import DrivenViewer
from browser.godot.engine import Engine, EngineSite
from browser.godot.pictures import SIZE, apart, from_viewer, ground_of, inner, poses_around
from browser.small_scenes import PHOTOGRAPHED, SMALL
from browser.watched_page import Watch
from conformance.landings_generate import THEMES
from conformance.landings_steps import CORPUS, read_histories
from engines.programs import ThreadedProxy
from eventually import eventually
from faults.service import Service
from playwright.sync_api import Browser, Page
from server.grid_scene import write_grid_scene

import terraport.sync
from terraport_payload import Texture, decode_segment, encode_segment
from terraport_pipeline.demo_scenes import SHIPPED_ID, shipped_scene
from terraport_pipeline.engines.ktx2 import encode_ktx2
from terraport_wire.limits import MAX_CONTAINER_ITEMS

OpenPage = Callable[..., tuple[Page, Watch]]

HERE = (30.0, 1.0, 30.0, 22.0)
THERE = (12.0, 1.0, 44.0, 15.0)
NEAR = (30.0, 1.0, 30.0, 8.0)
KEY_TABLES = ("have", "without")
PLACES = ((0.0, 2.0, 0.0, 45.0), (-35.0, 4.0, 20.0, 30.0), (20.0, 3.0, -30.0, 25.0))


@pytest.fixture(scope="module")
def grid_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `grid`, `levels` (two of them) and `big` (10 MB)."""
    root = tmp_path_factory.mktemp("grids")
    write_grid_scene(root / "grid")
    write_grid_scene(root / "levels", levels=2)
    write_grid_scene(root / "big", cells=80, name="big")
    return root


@pytest.fixture(scope="module")
def grids(grid_folder: Path) -> Iterator[Service]:
    """The service of these scenes."""
    with Service(grid_folder, max_sessions_per_ip=100) as running:
        yield running


@pytest.fixture(scope="module")
def running_engine(browser: Browser) -> Iterator[Engine]:
    """One page with the engine, for all tests of this file."""
    with EngineSite() as site:
        width, height = SIZE
        page = browser.new_page(viewport={"width": width, "height": height})
        yield Engine(page, site)


@pytest.fixture
def godot(running_engine: Engine) -> Iterator[Engine]:
    """The engine; what it complains of fails the test."""
    running_engine.complaints.clear()
    yield running_engine
    assert running_engine.complaints == []


def hidden_faces(session: Any) -> str:
    """Return the base faces that the Python SDK hides, as the addon has them."""
    return np.packbits(session.hidden_faces, bitorder="little").tobytes().hex()


@pytest.mark.parametrize("theme", THEMES)
def test_every_history(running_engine: Engine, theme: str) -> None:
    histories = read_histories(CORPUS / f"{theme}.jsonl")
    assert len(histories) >= 25
    for history in histories:
        steps = [step[:-1] for step in history["steps"]]
        told = running_engine.call("corpus", "play", [history["options"], steps])
        seen: dict[str, Any] = {"shown": [], "hidden": "00000000"}
        for number, (got, (*_, expected)) in enumerate(zip(told, history["steps"], strict=True)):
            assert got.get("error", "") == ""
            changed = as_told(got, seen)
            assert changed == expected, f"{history['history']}, step {number}: {steps[number]}"


def as_told(got: dict[str, Any], seen: dict[str, Any]) -> dict[str, Any]:
    """Return what a step of the corpus tells, and note in ``seen`` what is shown."""
    told = {"shown": sorted(got["shown"]), "hidden": crc(got["hidden"])}
    changed = {name: value for name, value in told.items() if value != seen[name]}
    seen |= told
    if got["inner"]:
        changed["inner"] = [got["inner"][0], crc(got["inner"][1])]
    if "sent" in got:
        changed["sent"] = [
            {
                name: sorted(value) if name in KEY_TABLES else value
                for name, value in message.items()
            }
            for message in got["sent"]
        ]
    return changed


def crc(digits: str) -> str:
    return f"{zlib.crc32(bytes.fromhex(digits)):08x}"


def test_every_message_and_frame(running_engine: Engine) -> None:
    """All that a server sends is read, or skipped, or refused; what a client writes reads back."""
    folder = CORPUS.parent / "messages"
    names = ("good", "bad_from_server", "frames")
    cases = [case for name in names for case in read_histories(folder / f"{name}.jsonl")]
    served = [case for case in cases if case["from"] == "server" and not is_of_groups(case)]
    assert len(served) >= 80
    data = [base64.b64decode(case["bytes"]) for case in served]
    padded = [
        base64.b64encode(
            one + bytes([case.get("pad_byte", 0)]) * (case.get("pad_to", 0) - len(one))
        ).decode()
        for one, case in zip(data, served, strict=True)
    ]
    read = running_engine.call("corpus", "read", [padded])
    for case, got in zip(served, read, strict=True):
        assert ("refused_by" in case) == (got.get("type") == "malformed"), case["case"]
        assert not (case.get("skip") and got), case["case"]
        for field, value in case.get("message", case.get("frame", {})).items():
            if field in {"show", "hidden", "missing", "inner_hidden", "offsets", "data"}:
                assert got[field] == base64.b64decode(value).hex(), case["case"]
            elif field not in {"server", "session", "scene", "limits"}:
                assert got[field] == value, case["case"]
    sent = [case["message"] for case in cases if case["from"] == "client" and "message" in case]
    written = running_engine.call("corpus", "write", [sent])
    assert [msgpack.unpackb(bytes.fromhex(one)) for one in written] == sent


@pytest.mark.parametrize("extra", [0, 1])
def test_arrays_and_maps_are_bounded(running_engine: Engine, extra: int) -> None:
    count = MAX_CONTAINER_ITEMS + extra
    for many in ([0] * count, dict.fromkeys(map(str, range(count)), 0)):
        data = base64.b64encode(msgpack.packb({"type": "notice", "kind": "new", "more": many}))
        (got,) = running_engine.call("corpus", "read", [[data.decode()]])
        assert got["type"] == ("malformed" if extra else "notice")


@pytest.mark.parametrize("damaged", [64, 65])
def test_a_landing_is_given_up_where_too_much_is_damaged(
    running_engine: Engine, damaged: int
) -> None:
    """Each segment is asked for twice; then at most 64 are left out."""

    def receive(message: bytes) -> list[Any]:
        return ["receive", base64.b64encode(message).decode()]

    limits = {"max_radius_m": 100.0, "max_messages_per_s": 100.0, "max_credit_bytes": 1 << 20}
    scene = {"version": "1" * 32, "segment_count": damaged, "base_faces": 8, "levels": 1}
    steps: list[list[Any]] = [
        ["connected"],
        receive(msgpack.packb({"type": "welcome", "scene": scene, "limits": limits})),
        ["land", [0.0, 0.0, 0.0], 10.0, None, None],
    ]
    keys = range(1, damaged + 1)
    plan = {
        "type": "plan",
        "show": b"".join(struct.pack("<Q5I", key, key, 4, 1, 3, 1) for key in keys),
        "hidden": gzip.compress(b"\0"),
        "effective_radius_m": 10.0,
        "omitted": 0,
    }
    for generation in (1, 2):
        frames = [
            struct.pack("<2BHIQ2I", 1, 0, 24, generation, key, 0, 4) + b"none" for key in keys
        ]
        steps += [["send"], receive(msgpack.packb(plan | {"generation": generation}))]
        steps += map(receive, frames)
        steps.append(receive(msgpack.packb({"type": "ready", "generation": generation})))
    *_, ready, sent = running_engine.call(
        "corpus", "play", [{"max_segments": None, "credit_bytes": 1 << 20}, [*steps, ["send"]]]
    )
    assert ready["error"] == ""
    if damaged == 64:
        (land,) = sent["sent"]
        assert len(land["without"]) == 64
    else:
        assert (ready["refused"], sent["sent"]) == ([1, "damaged"], [])


def is_of_groups(case: dict[str, Any]) -> bool:
    """Return whether a message is one that this client has no use for."""
    return case["case"].split(":")[0] in {"joined", "roster", "gathering", "gathered"}


def test_every_payload(running_engine: Engine) -> None:
    paths = sorted((CORPUS.parent / "scene" / "payload").glob("*.tsg"))
    assert len(paths) >= 40
    for path in paths:
        if path.stem == "good-ktx2":
            continue  # its image is a header alone, which the engine's library refuses
        expected = json.loads(path.with_name(f"{path.name}.json").read_text())
        payload = base64.b64encode(path.read_bytes()).decode()
        for wanted in [*expected.get("attributes", {}), ""]:
            scales = expected.get("scales", [])
            got = running_engine.call("corpus", "decode", [payload, scales, wanted])
            assert expected["good"] == (got["error"] == ""), f"{path.name}: {got['error']}"
            if expected["good"]:
                same_mesh(got, expected, wanted)


def test_a_ktx2_image_is_read(godot: Engine) -> None:
    """The corpus's own is a header alone; this one is as the pipeline makes them."""
    payload = (CORPUS.parent / "scene" / "payload" / "good-jpeg.tsg").read_bytes()
    image = encode_ktx2(np.full((64, 32, 3), 200, np.uint8), 128)
    mesh = replace(decode_segment(payload, scales=None), texture=Texture.of(image))
    encoded = encode_segment(mesh, step_m=2.0**-12, scales={})
    got = godot.call("corpus", "decode", [base64.b64encode(encoded).decode(), [], ""])
    assert (got["error"], got["image"]) == ("", [32, 64])


def same_mesh(got: dict[str, Any], expected: dict[str, Any], attribute: str) -> None:
    def floats(name: str, columns: int) -> Any:
        return np.frombuffer(bytes.fromhex(got[name]), "<f4").reshape(-1, columns)

    # Godot's front faces are clockwise.
    faces = np.array(got["faces"]).reshape(-1, 3)[:, [0, 2, 1]]
    assert faces.tolist() == expected["faces"]
    assert floats("positions", 3).tolist() == expected["positions"]
    assert np.allclose(floats("normals", 3), expected["normals"], atol=1e-6)
    assert got["colours"] == (expected["colours"] or [])
    assert floats("uvs", 2).tolist() == expected.get("uvs", [])
    facts = floats("facts", 2)
    regions = facts[:, 0].tolist() or [got["region"]] * len(expected["positions"])
    assert regions == (expected["region_ids"] or [-1] * len(regions))
    image = expected.get("texture")
    assert got["image"] == ([] if image is None else [image["width"], image["height"]])
    if attribute:
        values = [-1e30 if one is None else one for one in expected["attributes"][attribute]]
        assert np.allclose(facts[:, 1], values)


def test_a_landing_a_hop_and_a_return(godot: Engine, grids: Service) -> None:
    """What is drawn is what the Python SDK shows, base faces too; a return takes one frame."""
    assert godot.open(grids.url, "grid") == "opened"
    received, landed = 0, {}
    with terraport.sync.connect(f"{grids.url}/scenes/grid") as session:
        for place in (HERE, THERE, NEAR, HERE):
            landed = godot.land(*place)
            session.land(place[:3], place[3]).ready()
            assert landed["visible"] == sorted(session.visible)
            assert landed["hidden"] == hidden_faces(session)
            assert landed["meshes"] == len(landed["visible"]) + 1, "and the base"
            received, before = landed["stats"]["received_bytes"], received
    assert (landed["frames"], received) == (0, before), "a return costs no frame and no byte"
    assert landed["stats"]["repeated_bytes"] == 0
    assert godot.events("link") == [1, 2], "connecting, open"


def test_a_ring_of_the_coarser_level_comes_and_can_be_left_out(
    godot: Engine, grids: Service
) -> None:
    x, y, z, radius_m = NEAR
    with terraport.sync.connect(f"{grids.url}/scenes/levels") as session:
        for ring_m in (3 * radius_m, None):
            godot.open(grids.url, "levels", shows_coarse=ring_m is not None)
            landed = godot.land(*NEAR)
            session.land((x, y, z), radius_m, coarse_radius_m=ring_m).ready()
            assert landed["visible"] == sorted(session.visible)
            assert landed["hidden"] == hidden_faces(session)


def test_a_newer_landing_supersedes_the_older(godot: Engine, grids: Service) -> None:
    with ThreadedProxy(grids.url) as line:
        line.proxy.bytes_per_s = 4e6
        godot.open(line.url, "big")
        first = godot.call("begin_landing", 30, 1, 30, 100)
        time.sleep(0.5)
        landed = godot.land(5, 1, 5, 2)
    assert godot.events("superseded") == [[first, landed["landing"]]]
    assert godot.events("shown") == [landed["landing"]]
    assert landed["visible"] == [0]
    assert landed["stats"]["repeated_bytes"] == 0


def test_a_landing_survives_lost_connections(godot: Engine, grids: Service) -> None:
    """Cut twice in the middle of a landing: it is shown whole, and nothing comes twice."""
    with ThreadedProxy(grids.url) as line:
        line.proxy.bytes_per_s = 4e6
        godot.open(line.url, "big")
        godot.call("begin_landing", 30, 1, 30, 100)
        for sent in (1_000_000, 2_500_000):
            end_s = time.monotonic() + 60
            while line.proxy.down_bytes < sent and time.monotonic() < end_s:
                time.sleep(0.01)
            line.cut()
        landed = godot.call("until_shown", 1)
    assert landed["visible"] == list(range(36))
    assert landed["stats"]["repeated_bytes"] == 0
    assert godot.events("link") == [1, 2] + [3, 1, 2] * 2, "waiting, connecting, open"


@pytest.mark.parametrize(("place", "seed"), [(HERE, 2), (NEAR, 3)])
def test_a_service_that_is_killed_comes_back_with_another_version(
    godot: Engine, tmp_path: Path, place: tuple[float, float, float, float], seed: int
) -> None:
    """What was shown goes. A landing that was begun, or else the last again, waits for the base."""
    write_grid_scene(tmp_path / "grid", seed=1)
    with Service(tmp_path) as service:
        godot.open(service.url, "grid")
        before = godot.land(*NEAR)
        service.kill()
        write_grid_scene(tmp_path / "grid", seed=seed)  # the browser keeps bases that it had
        if place != NEAR:
            godot.call("begin_landing", *place)
        with godot.site.without_base():
            service.start()
            with terraport.sync.connect(f"{service.url}/scenes/grid") as session:
                session.land(place[:3], place[3]).ready()
                expected = sorted(session.visible), hidden_faces(session)
            loaded = before["instances"] + len(expected[0])
            eventually(lambda: godot.call("state")["instances"] == loaded, 60)
            state = godot.call("state")
            assert (state["visible"], state["hidden"]) == ([], ""), "on the old base"
        landed = [before["landing"], 0, before["landing"] + 1]
        eventually(lambda: godot.events("shown") == landed, 60)
    state = godot.call("state")
    assert (state["visible"], state["hidden"]) == expected
    assert state["stats"]["repeated_bytes"] == 0


def test_a_landing_that_was_not_shown_ends_with_its_version(godot: Engine, tmp_path: Path) -> None:
    write_grid_scene(tmp_path / "grid", seed=1)
    with Service(tmp_path) as service:
        godot.open(service.url, "grid", auto_show=False)
        godot.call("begin_landing", *NEAR)
        eventually(lambda: godot.events("presentable") == [1], 60)
        service.kill()
        write_grid_scene(tmp_path / "grid", seed=4)
        with godot.site.without_base():
            service.start()
            eventually(lambda: godot.events("superseded") == [[1, 2]], 60)
            assert not godot.call("show_landing")
        eventually(lambda: godot.events("presentable") == [1, 2], 60)
        assert godot.call("show_landing")
        with terraport.sync.connect(f"{service.url}/scenes/grid") as session:
            session.land(NEAR[:3], NEAR[3]).ready()
            assert godot.call("state")["visible"] == sorted(session.visible)
            assert godot.call("state")["hidden"] == hidden_faces(session)


def test_past_the_deadline_the_inner_part_is_shown_first(godot: Engine, grids: Service) -> None:
    with ThreadedProxy(grids.url) as line:
        line.proxy.bytes_per_s = 4e6
        godot.open(line.url, "big")
        first = godot.call("begin_landing", 30, 1, 30, 100, 5, 0.1)
        inner = godot.call("until_shown", first)
        whole = godot.call("until_shown", first, 2)
    assert 0 < len(inner["visible"]) < len(whole["visible"]) == 36
    assert inner["hidden"] != whole["hidden"]


def test_a_refused_landing_changes_nothing(godot: Engine, grids: Service) -> None:
    godot.open(grids.url, "grid")
    before = godot.land(*NEAR)
    godot.call("begin_landing", 30, 1, 30, 1e6)
    eventually(lambda: godot.events("refused") == ["radius_too_large"], 60)
    assert godot.call("state")["visible"] == before["visible"]
    assert godot.land(*HERE)["visible"] != before["visible"]


def test_what_a_landing_left_is_freed(godot: Engine, grids: Service) -> None:
    """Without room beside what is shown, meshes of earlier landings leave memory."""
    godot.open(grids.url, "big", device=2)
    for hop in range(6):
        landed = godot.land(5.0 + 50.0 * (hop % 2), 1.0, 30.0, 12.0)
        assert landed["instances"] == len(landed["visible"]) + 1, "and the base"
        assert landed["stats"]["repeated_bytes"] == 0


def test_a_token_opens_and_a_wrong_one_fails_once(godot: Engine, grid_folder: Path) -> None:
    token = "a-token-that-is-long-enough"
    with Service(grid_folder, token=token) as guarded:
        assert godot.open(guarded.url, "grid", token=token) == "opened"
        assert godot.land(*NEAR)["visible"] != []
        assert godot.open(guarded.url, "grid", token="not-the-right-token") == "failed"
        assert [code for code, _ in godot.events("failed")] == ["unauthorised"]


def test_prefetched_ground_picks_and_rays(godot: Engine, grids: Service) -> None:
    """A prefetch makes the landing free; rays meet what is shown, picks what the service has."""
    godot.open(grids.url, "grid", collision_layer=1)
    godot.land(5, 1, 5, 3)
    loaded = godot.call("prefetch", *HERE)
    landed = godot.land(*HERE)
    assert landed["stats"]["received_bytes"] == loaded
    spots = ((3.0, 3.0), (21.0, 30.0), (30.5, 30.0), (39.0, 30.0), (57.0, 57.0))
    rays = [[x, 100.0, z, 0.0, -1.0, 0.0] for x, z in spots]
    hits = godot.call("cast", rays)
    assert [hit[3] >= 0 for hit in hits] == [False, True, True, True, False], "detail, and base"
    for hit, solid in zip(hits, godot.call("collide", rays), strict=True):
        assert solid == ([] if hit[3] < 0 else pytest.approx(hit[:3], abs=0.001))
    hit = godot.call("pick", 30.5, 50, 30)
    assert hit["position"][1] == pytest.approx(hits[2][1], abs=0.01)
    assert hit["attributes"]["grade"] == pytest.approx(0.5 + 30.5 / 100, abs=0.01)


@pytest.mark.parametrize("scene", [SMALL, PHOTOGRAPHED])
def test_landings_look_as_in_the_viewer(
    godot: Engine, open_page: OpenPage, server: Service, scene: str
) -> None:
    """The same ground, and no background where base alone or detail alone covers."""
    width, height = SIZE
    page, _ = open_page(
        reduced_motion="reduce",
        viewport={"width": 2 * width, "height": 2 * height},
        device_scale_factor=0.5,
    )
    viewer = DrivenViewer(page, server.url, scene)
    viewer.open("&mode=colour")
    godot.open(server.url, scene)
    chance = random.Random(4)
    covered, pictures = 0, []
    for place in PLACES:
        poses = poses_around(place[:3], chance, place[3])
        base = [ground_of(godot.picture(*vars(pose).values())) for pose in poses]
        landed = godot.land(*place)
        assert sorted(viewer.land(place[:3], place[3])["visible"]) == landed["visible"]
        for pose, before in zip(poses, base, strict=True):
            drawn = godot.picture(*vars(pose).values())
            ground = ground_of(drawn)
            other = from_viewer(viewer, pose)
            difference = apart((drawn, ground), other)
            assert difference.mean <= 2.0, difference
            assert difference.far <= 0.01, difference
            assert difference.uncovered <= 0.001, difference
            assert not (inner(before) & ~ground).any()
            covered += int(ground.sum())
            pictures.append((drawn, ground))
        godot.land(5000, 0, 0, 1)  # nothing but the base
    assert covered > 50_000
    # A picture of another place is found; so is one that is a little darker.
    assert apart(pictures[0], pictures[2]).mean > 2.0
    assert apart(pictures[0], ((pictures[0][0] * 0.97).astype(np.uint8), pictures[0][1])).mean > 2.0


def test_places_are_those_of_the_python_sdk(godot: Engine, tmp_path: Path) -> None:
    """Regions that people have named are places to land at."""
    scene = Path(shutil.copytree(shipped_scene(), tmp_path / SHIPPED_ID))
    (regions,) = scene.glob("v-*/regions.json")
    rows = json.loads(regions.read_text())["regions"][:2]
    labels = [{"stable_id": row["stable_id"], "label": f"Grube {row['id']}"} for row in rows]
    document = {"format": "terraport-labels", "format_version": "1.0", "labels": labels}
    (scene / "labels.json").write_text(json.dumps(document))
    with Service(tmp_path) as service:
        godot.open(service.url, SHIPPED_ID)
        found = {place[0]: place[1:] for place in godot.call("places")}
        with terraport.sync.connect(f"{service.url}/scenes/{SHIPPED_ID}") as session:
            expected = session.places()
    assert {"Grube 0", "Grube 1"} <= found.keys() == {place.label for place in expected}
    for place in expected:
        region, *position, radius_m = found[place.label]
        assert region == place.region
        assert position == pytest.approx(place.position, abs=0.01)
        assert radius_m == pytest.approx(place.radius_m)


def test_every_look_is_drawn(godot: Engine, server: Service) -> None:
    """Regions, segments, attribute and slope differ from each other and from the ground lit."""
    pictures = []
    for lit in (False, True):
        godot.open(server.url, SMALL, attribute="grade", lit=lit)
        godot.land(*PLACES[0])
        for look in range(1 if lit else 5):
            godot.call("set_look", look)
            pictures.append(godot.picture((0.0, 60.0, 60.0), 0.0, -45.0).astype(int))
    for one, other in itertools.combinations(pictures, 2):
        assert np.abs(one - other).mean() > 5


def test_the_example_walks(godot: Engine, grids: Service) -> None:
    """It lands without a line of code, and a click goes there in one frame, behind a fade."""
    godot.site.target = grids.url
    told = godot.call("walk_example", f"{godot.site.url}/scenes/grid", 12.0, 44.0)
    assert told["first"] != told["second"] != []
    x, y, z = told["eye"]
    assert (x, z) == pytest.approx((12.0, 44.0), abs=0.01)
    assert y - told["ground_m"] == pytest.approx(1.7, abs=0.01)
    assert told["frames"] == [told["frames"][0]] * 2, "shown and moved"
