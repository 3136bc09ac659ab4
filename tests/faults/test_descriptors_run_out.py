"""File descriptors: one per client, and what happens when none is left."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from eventually import eventually
from faults.service import PROGRAM, Service
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient, client_context
from server.test_access_watch import write_certificate
from websockets.exceptions import InvalidStatus

from terraport_server.scenes.registry import SceneRegistry
from terraport_store import change_labels
from terraport_wire import Ready

resource = pytest.importorskip("resource")

pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="counts in /proc")

CLIENTS = 12


def with_limit(limit: int) -> str:
    """Return a program that serves with that many descriptors and cannot raise the limit."""
    lines = f"import resource; resource.setrlimit(resource.RLIMIT_NOFILE, ({limit}, {limit}))"
    return f"{lines}; {PROGRAM}"


def descriptors(service: Service) -> int:
    assert service.process is not None
    return len(list(Path(f"/proc/{service.process.pid}/fd").iterdir()))


def landed(url: str, **options: object) -> PlainClient:
    """Return a client after its first landing."""
    client = PlainClient(url, **options)
    client.hello()
    client.land(1, (30.0, 1.0, 30.0), 500.0)
    client.until(Ready)
    return client


@pytest.mark.parametrize("tls", [False, True])
def test_a_session_takes_one_descriptor(tmp_path: Path, tls: bool) -> None:
    write_grid_scene(tmp_path / "scenes" / "pit", cells=20)
    settings = {}
    options = {}
    if tls:
        write_certificate(tmp_path, "localhost")
        settings = {"ssl_certfile": tmp_path / "cert.pem", "ssl_keyfile": tmp_path / "key.pem"}
        options = {"ssl": client_context()}
    with Service(tmp_path / "scenes", **settings) as service:
        url = f"{service.url}/scenes/pit".replace("http", "https" if tls else "http")
        landed(url, **options).socket.close()  # what the first landing opens for all
        before = descriptors(service)
        clients = [landed(url, **options) for _ in range(CLIENTS)]
        assert descriptors(service) <= before + CLIENTS
        for client in clients:
            client.socket.close()


def test_a_body_that_waits_for_its_client_takes_no_descriptor_of_its_own(tmp_path: Path) -> None:
    """HTTP clients that pull payload and read slowly: their connection, and the file of all."""
    write_grid_scene(tmp_path / "scenes" / "pit", cells=60)
    request = b"GET /scenes/pit/segments/3.glb HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with Service(tmp_path / "scenes") as service:
        glb = httpx.get(f"{service.url}/scenes/pit/segments/3.glb").content
        before = descriptors(service)
        clients = []
        for _ in range(CLIENTS):
            client = socket.socket()
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            client.settimeout(20)
            client.connect(("127.0.0.1", service.port))
            client.sendall(request)
            clients.append(client)
        heads = [client.recv(64) for client in clients]
        assert all(head.startswith(b"HTTP/1.1 200") for head in heads)
        assert descriptors(service) <= before + CLIENTS
        for client, body in zip(clients, heads, strict=True):
            while len(body.partition(b"\r\n\r\n")[2]) < len(glb):
                body += client.recv(1 << 16)
            assert body.partition(b"\r\n\r\n")[2] == glb
            client.close()


def test_without_descriptors_clients_get_503_and_scenes_are_watched(tmp_path: Path) -> None:
    scenes = tmp_path / "scenes"
    write_grid_scene(scenes / "pit", cells=2)
    limits = {"max_sessions": 1000, "max_sessions_per_ip": 1000}
    with Service(scenes, program=with_limit(80), **limits) as service:
        url = f"{service.url}/scenes/pit"
        clients: list[PlainClient] = []
        refused = 0
        while refused < 10:  # a look at the scenes takes some for a moment
            try:
                clients.append(landed(url))
            except InvalidStatus as refusal:
                refused += b"descriptors" in refusal.response.body
        assert 30 < len(clients) < 80
        answer = httpx.get(f"{service.url}/scenes", timeout=10)
        assert answer.status_code == 503
        assert answer.json()["error"]["code"] == "connections"
        # Scenes that appear, and new labels, are still noticed; those inside can still land.
        write_grid_scene(scenes / "quarry", cells=2)
        eventually(lambda: "scene=quarry" in service.log)
        clients[0].land(2, (0.0, 1.0, 0.0), 10.0)
        clients[0].until(Ready)
        for client in clients:
            client.socket.close()
        eventually(lambda: httpx.get(f"{service.url}/scenes").status_code == 200)
        listed = httpx.get(f"{service.url}/scenes").json()["scenes"]
        assert [scene["id"] for scene in listed] == ["pit", "quarry"]
        landed(url).socket.close()
        assert " error " not in service.log


def test_many_at_once_beyond_the_descriptors_are_all_answered(tmp_path: Path) -> None:
    write_grid_scene(tmp_path / "scenes" / "pit", cells=2)
    request = b"GET /scenes HTTP/1.1\r\nHost: localhost\r\n\r\n"

    async def ask(port: int, together: asyncio.Event) -> str:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        await together.wait()
        try:
            writer.write(request)
            return (await reader.readuntil(b"\r\n")).split()[1].decode()
        except (ConnectionError, asyncio.IncompleteReadError):
            return "closed"
        finally:
            writer.close()

    async def all_of_them(port: int) -> Counter[str]:
        together = asyncio.Event()
        tasks = [asyncio.create_task(ask(port, together)) for _ in range(300)]
        await asyncio.sleep(0.5)
        together.set()
        async with asyncio.timeout(30):
            return Counter(await asyncio.gather(*tasks))

    with Service(tmp_path / "scenes", program=with_limit(100)) as service:
        answered = asyncio.run(all_of_them(service.port))
        assert answered.keys() <= {"200", "503", "closed"}
        assert httpx.get(f"{service.url}/scenes", timeout=10).status_code == 200


@contextlib.contextmanager
def none_left() -> Iterator[None]:
    """Use up the descriptors of this process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    taken = [os.open(os.devnull, os.O_RDONLY)]
    resource.setrlimit(resource.RLIMIT_NOFILE, (taken[0] + 8, hard))
    try:
        with contextlib.suppress(OSError):
            while True:
                taken.append(os.dup(taken[0]))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        for descriptor in taken:
            os.close(descriptor)


def test_a_scene_that_found_no_descriptor_is_opened_later(tmp_path: Path) -> None:
    """It counted as one that cannot be opened, and was not tried again until it changed."""

    async def story() -> None:
        write_grid_scene(tmp_path / "pit", cells=2, stable_ids=(1, 2, 3))
        registry = SceneRegistry(tmp_path)
        await registry.refresh()
        write_grid_scene(tmp_path / "quarry", cells=2)
        change_labels(tmp_path / "pit", {1: "berm"})
        looks = registry.root.look()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(registry.root, "look", lambda: looks)
            with none_left(), contextlib.suppress(OSError):
                await registry.refresh()
        assert registry.ids() == ["pit"]
        await registry.refresh()
        assert registry.ids() == ["pit", "quarry"]
        assert registry.get("pit").labels_file.labels == {1: "berm"}
        registry.close()

    asyncio.run(story())


def test_the_watch_survives_whatever_a_look_raises(tmp_path: Path) -> None:
    async def story() -> None:
        registry = SceneRegistry(tmp_path)
        look, calls = registry.root.look, 0

        def fails_once() -> object:
            nonlocal calls
            calls += 1
            if calls == 1:
                raise RuntimeError("can't start new thread")
            return look()

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(registry.root, "look", fails_once)
            watch = asyncio.create_task(registry.watch(0.01))
            write_grid_scene(tmp_path / "pit", cells=2)
            async with asyncio.timeout(10):
                while registry.is_empty:
                    assert not watch.done()
                    await asyncio.sleep(0.01)
            watch.cancel()
        registry.close()

    asyncio.run(story())
