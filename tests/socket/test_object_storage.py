"""Landings from object storage over real sockets: a real S3 service, and what may befall it.

Each fault has a stated outcome (docs/how-to/object-storage.md has the table).
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
import xxhash
from eventually import eventually
from s3_servers import Fault, FaultProxy, ProxiedRequest, s3_environment
from server.grid_scene import SIDE, TILE_M, GridScene, write_grid_scene
from server.plain_client import Piece, PlainClient, assemble, follows

from terraport_server import BackgroundServer
from terraport_server.scenes.roots import ObjectRoot
from terraport_store.origin import ObjectCounts, ObjectOptions, Origin
from terraport_store.upload import upload_scene
from terraport_wire import Credit, Notice, Pick, Picked, Plan, Ready

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
EVERYWHERE_M = 100.0

TIMEOUT_S = 1.2
"""object_timeout_s: everything of it scales with it."""


@pytest.fixture
def proxy(weed: str) -> Iterator[FaultProxy]:
    with FaultProxy(weed) as between, s3_environment(between.url):
        yield between


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> tuple[GridScene, GridScene]:
    """Two scenes of different bytes."""
    root = tmp_path_factory.mktemp("local")
    return (
        write_grid_scene(root / "pit", stable_ids=(4, 2, 9)),
        write_grid_scene(root / "well", seed=3),
    )


@pytest.fixture(scope="module")
def stored(weed: str, scenes: tuple[GridScene, GridScene]) -> str:
    """Where both were uploaded to."""
    url = "s3://scenes/both"
    with s3_environment(weed):
        for scene in scenes:
            upload_scene(scene.path, f"{url}/{scene.path.name}")
    return url


@pytest.fixture
def url(stored: str, proxy: FaultProxy) -> str:
    """The same, with the proxy in between."""
    assert proxy.url
    return stored


def serve(url: str, tmp_path: Path, **settings: object) -> BackgroundServer:
    return BackgroundServer(
        url,
        **{
            "object_timeout_s": TIMEOUT_S,
            "object_poll_s": 0.1,
            "object_cache_dir": tmp_path / "cache",
            **settings,
        },
    )


def counts(server: BackgroundServer) -> ObjectCounts:
    root = server.service.registry.root
    assert isinstance(root, ObjectRoot)
    return root.storage.counts


def pack_of(scene: str, fault: Fault) -> Callable[[ProxiedRequest], Fault | None]:
    """The fault for all reads of a scene's packs."""

    def rule(request: ProxiedRequest) -> Fault | None:
        hits_scene = request.method == "GET" and f"/{scene}/" in request.path
        return fault if hits_scene and request.path.endswith(".pack") else None

    return rule


def some(
    number: int, rule: Callable[[ProxiedRequest], Fault | None]
) -> Callable[[ProxiedRequest], Fault | None]:
    """The first so many faults of a rule."""
    left = [number]

    def limited(request: ProxiedRequest) -> Fault | None:
        fault = rule(request)
        if fault is None or left[0] <= 0:
            return None
        left[0] -= 1
        return fault

    return limited


def land(
    client: PlainClient, generation: int = 1, radius_m: float = EVERYWHERE_M
) -> tuple[list[int], dict[int, bytes]]:
    """Land without anything; return what is missing and the payloads by segment."""
    client.land(generation, CENTRE, radius_m)
    ready, pieces, _ = client.until(Ready)
    return client.missing(ready), assemble(pieces)


def all_of(scene: GridScene) -> dict[int, bytes]:
    return dict(enumerate(scene.payloads))


def test_a_landing_brings_the_same_bytes_cold_warm_and_after_a_restart(
    proxy: FaultProxy, url: str, scenes: tuple[GridScene, GridScene], tmp_path: Path
) -> None:
    pit = scenes[0]
    for start in range(2):
        proxy.requests.clear()
        with serve(url, tmp_path, object_poll_s=60.0) as server:
            for _ in range(2):
                with PlainClient(server.scene_url("pit")) as client:
                    client.hello()
                    missing, received = land(client)
                assert missing == []
                assert received == all_of(pit)
        reads = [request for request in proxy.of(".pack") if "/pit/" in request.path]
        # Headers of two packs as they are opened; then neighbours by few requests; warm: none.
        assert len(reads) <= (2 + 8 if start == 0 else 2)


def test_a_landing_larger_than_what_is_read_ahead(
    proxy: FaultProxy, url: str, scenes: tuple[GridScene, GridScene], tmp_path: Path
) -> None:
    """The hints keep pace with what is sent: most payloads come with a neighbour, before need."""
    ahead_bytes = sum(map(len, scenes[0].payloads)) // 4
    with serve(url, tmp_path, object_read_ahead_bytes=ahead_bytes) as server:
        with PlainClient(server.scene_url("pit")) as client:
            client.hello()
            proxy.requests.clear()
            proxy.rule = pack_of("pit", Fault(delay_s=0.02))
            assert land(client)[1] == all_of(scenes[0])
        assert len(proxy.of("segments.pack")) < 0.75 * SIDE * SIDE


def test_everything_beside_the_stream_is_there_too(
    url: str, scenes: tuple[GridScene, GridScene], tmp_path: Path
) -> None:
    pit = scenes[0]
    Origin(f"{url}/pit", ObjectOptions()).put("report.html", b"<p>fine</p>")
    with serve(url, tmp_path) as server, httpx.Client(base_url=server.url) as http:
        listed = http.get("/scenes").json()["scenes"]
        assert [scene["id"] for scene in listed] == ["pit", "well"]
        for key in ("base.tsg", "regions.json"):
            file = pit.path / pit.manifest.files[key].path
            assert http.get(f"/scenes/pit/{key}").content == file.read_bytes()
        partial = http.get("/scenes/pit/base.tsg", headers={"range": "bytes=10-29"})
        assert partial.status_code == 206
        assert len(partial.content) == 20
        assert http.get("/scenes/pit/segments/5.glb").content == pit.glb(5)
        assert http.get("/scenes/pit/report").text == "<p>fine</p>"
        assert http.get("/scenes/well/report").status_code == 404
        with PlainClient(server.scene_url("pit")) as client:
            client.hello()
            client.send(Pick(request=1, origin=(5.0, 50.0, 5.0), direction=(0.0, -1.0, 0.0)))
            assert client.expect(Picked).hit is not None


@pytest.mark.parametrize(
    "fault",
    [Fault(status=503), Fault(cut_at=500), Fault(flip_at=100)],
    ids=["503", "cut in mid-body", "wrong bytes"],
)
def test_a_fault_that_passes_costs_time_only(
    proxy: FaultProxy,
    url: str,
    scenes: tuple[GridScene, GridScene],
    tmp_path: Path,
    fault: Fault,
) -> None:
    with serve(url, tmp_path) as server, PlainClient(server.scene_url("pit")) as client:
        client.hello()
        # Wrong bytes are asked for once more: twice wrong in a row would be a corrupt segment.
        proxy.rule = some(1 if fault.flip_at else 2, pack_of("pit", fault))
        missing, received = land(client)
        assert missing == []
        assert received == all_of(scenes[0])
        seen = counts(server)
        assert (seen.wrong if fault.flip_at else seen.retries) >= 1


@pytest.mark.parametrize(
    "fault",
    [Fault(status=503), Fault(cut_at=500), Fault(delay_s=1.0)],
    ids=["503", "cut in mid-body", "stalled"],
)
def test_a_fault_without_end_costs_its_own_scene_only(
    proxy: FaultProxy,
    url: str,
    scenes: tuple[GridScene, GridScene],
    tmp_path: Path,
    fault: Fault,
) -> None:
    """Its segments are missing in a bounded time, the session goes on, and others notice nothing;
    once it is over, the same session lands there whole."""
    with (
        serve(url, tmp_path) as server,
        PlainClient(server.scene_url("pit")) as client,
        PlainClient(server.scene_url("well")) as other,
        ThreadPoolExecutor(1) as pool,
    ):
        client.hello()
        other.hello()
        proxy.rule = pack_of("pit", fault)
        began_s = time.monotonic()
        landing = pool.submit(land, client)
        while not any("/pit/" in request.path for request in proxy.of(".pack")[3:]):
            time.sleep(0.01)
        missing, received = land(other)
        took_s = time.monotonic() - began_s
        assert received == all_of(scenes[1])
        assert missing == []
        assert took_s < 1.0
        assert not landing.done()
        missing, received = landing.result(20)
        assert time.monotonic() - began_s < 4.0 * TIMEOUT_S
        assert received == {}
        assert missing == list(range(SIDE * SIDE))
        assert httpx.get(f"{server.url}/scenes/pit/segments/1.glb").status_code == 503
        proxy.rule = lambda _: None
        time.sleep(TIMEOUT_S / 4 + 0.05)
        assert land(client, 2)[1] == all_of(scenes[0])


def test_wrong_bytes_are_never_sent_or_kept(
    proxy: FaultProxy, url: str, scenes: tuple[GridScene, GridScene], tmp_path: Path
) -> None:
    with serve(url, tmp_path) as server, PlainClient(server.scene_url("pit")) as client:
        client.hello()
        proxy.rule = pack_of("pit", Fault(flip_at=100))
        lost, received = land(client)
        missing = set(lost)
        assert missing
        # Neighbours in one answer are each judged by their own hash.
        assert received == {n: data for n, data in all_of(scenes[0]).items() if n not in missing}
        # A payload whose own request came to nothing may be kept as a neighbour of another's: what
        # counts is that each file holds what its name says.
        kept = list((tmp_path / "cache").glob("*/??/*-*"))
        assert kept
        for path in kept:
            assert path.name.startswith(f"{xxhash.xxh3_64_intdigest(path.read_bytes()):016x}-")
        proxy.rule = lambda _: None
        for generation in range(10, 20):  # a busy machine's timeout may cost one landing a payload
            _, received = land(client, generation)
            missing -= set(received)
            if not missing:
                break
        assert not missing


def test_a_full_cache_disk_costs_nobody_a_segment(
    url: str, scenes: tuple[GridScene, GridScene], tmp_path: Path
) -> None:
    """A file system of 96 KiB, of which the scenes' small files take most."""
    disk = tmp_path / "small"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=96k", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True, check=False, timeout=10).returncode:
        pytest.skip("needs the right to mount a small file system")
    try:
        with (
            serve(f"{url}/pit", tmp_path, object_cache_dir=disk) as server,
            PlainClient(server.scene_url("pit")) as client,
        ):
            client.hello()
            missing, received = land(client)
            assert missing == []
            assert received == all_of(scenes[0])
            assert counts(server).uncached > 0
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True, timeout=10)


def test_the_bucket_is_gone(
    proxy: FaultProxy, url: str, scenes: tuple[GridScene, GridScene], tmp_path: Path
) -> None:
    """What is open stays served: cached segments arrive, the others are missing."""
    with serve(url, tmp_path) as server, PlainClient(server.scene_url("pit")) as client:
        client.hello()
        _, near = land(client, 1, 8.0)
        proxy.rule = lambda _: Fault(status=404)
        missing, received = land(client, 2)
        assert set(missing).isdisjoint(near)
        assert set(near) <= set(received)
        assert set(received) | {*missing} == set(range(SIDE * SIDE))
        time.sleep(0.3)  # three looks at what is not there
        with PlainClient(server.scene_url("pit")) as late:
            late.hello()
            _, again = land(late, 1, 8.0)
        assert again == near


def test_a_scene_republished_in_mid_landing(proxy: FaultProxy, tmp_path: Path) -> None:
    """The landing ends with the version that it began with, and its client gets a notice."""
    first = write_grid_scene(tmp_path / "own")
    url = f"s3://scenes/{tmp_path.name}/own"
    upload_scene(first.path, url)
    with serve(url, tmp_path) as server, PlainClient(server.scene_url("own")) as client:
        welcome = client.hello(credit_bytes=20_000)
        client.land(1, CENTRE, EVERYWHERE_M)
        plan = client.expect(Plan)
        frames = []
        while client.taken_bytes < 20_000:
            got = client.receive()
            assert isinstance(got, Piece)
            frames.append(got)
        second = write_grid_scene(tmp_path / "own", seed=1)
        upload_scene(second.path, url)
        _, more, _ = client.until(Notice)
        frames += more
        client.send(Credit(bytes=1 << 30))
        _, more, _ = client.until(Ready)
        frames += more
        assert len(follows(plan)) == SIDE * SIDE
        assert assemble(frames) == all_of(first)
        assert welcome.scene.version == first.manifest.version
        with PlainClient(server.scene_url("own")) as late:
            assert late.hello().scene.version == second.manifest.version
            assert land(late)[1] == all_of(second)


def test_storage_that_comes_late(
    proxy: FaultProxy, url: str, scenes: tuple[GridScene, GridScene], tmp_path: Path
) -> None:
    """The service starts without it, says that it has no scene, and serves once it is there."""
    proxy.rule = lambda _: Fault(status=503)
    with serve(url, tmp_path, object_timeout_s=0.4) as server:
        assert httpx.get(f"{server.url}/readyz").status_code == 503
        proxy.rule = lambda _: None
        eventually(lambda: httpx.get(f"{server.url}/scenes/well").status_code == 200)
        assert httpx.get(f"{server.url}/readyz").status_code == 200
        with PlainClient(server.scene_url("well")) as client:
            client.hello()
            assert land(client)[1] == all_of(scenes[1])


def test_it_stops_in_bounded_time_whatever_storage_does(
    proxy: FaultProxy, url: str, tmp_path: Path
) -> None:
    with serve(
        url, tmp_path, object_timeout_s=8.0, drain_timeout_s=0.2, close_timeout_s=0.5
    ) as server:
        client = PlainClient(server.scene_url("pit"))
        client.hello()
        proxy.rule = pack_of("pit", Fault(status=503))
        client.land(1, CENTRE, EVERYWHERE_M)
        client.expect(Plan)
        eventually(lambda: counts(server).retries > 0)
        began_s = time.monotonic()
        server.stop()
        assert time.monotonic() - began_s < 4.0
        client.socket.close()
