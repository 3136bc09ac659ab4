"""Disks that fill up, and files that go: what clients were given stays right, the service stays up.

A real small file system is mounted for it, which needs root; elsewhere that part is skipped.
Bytes that go bad on disk are in tests/socket/test_integrity.py, object storage in
tests/store/test_remote_source.py.
"""

from __future__ import annotations

import asyncio
import logging
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from eventually import eventually
from server.grid_scene import SIDE, TILE_M, GridScene, write_grid_scene
from server.plain_client import PlainClient, assemble, make_land

import terraport
from terraport_server import BackgroundServer
from terraport_store import OutOfSpaceError
from terraport_wire import Credit, Plan, Ready

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
EVERYWHERE = make_land(1, CENTRE, 100.0)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 3 MiB."""
    mount_point = tmp_path / "small"
    mount_point.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(mount_point)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("no mount command")
    if done.returncode:
        pytest.skip(f"no small disk: {done.stderr.strip()}")
    yield mount_point
    subprocess.run(["umount", "-l", str(mount_point)], check=True)


def errors(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.message for record in caplog.records if record.levelno >= logging.ERROR]


def land_whole(url: str, scene: GridScene) -> None:
    with PlainClient(url) as client:
        client.hello()
        client.send(EVERYWHERE)
        frames = client.until(Ready)[1]
        payloads = assemble(frames)
        assert [payloads[number] for number in range(SIDE * SIDE)] == scene.payloads


def test_a_publication_that_finds_the_disk_full(
    small_disk: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """It fails, and says so; the version before it is served as if nothing had been."""
    scene = write_grid_scene(small_disk / "scenes" / "grid", cells=8)
    with BackgroundServer(small_disk / "scenes", scene_poll_s=0.1) as service:
        url = f"{service.url}/scenes/grid"
        with PlainClient(url) as client:
            client.hello(credit_bytes=5000)
            client.send(EVERYWHERE)
            client.expect(Plan)
            with pytest.raises(OutOfSpaceError):
                write_grid_scene(small_disk / "scenes" / "grid", seed=1, cells=60)
            client.send(Credit(bytes=1 << 24))
            payloads = assemble(client.until(Ready)[1])
            assert [payloads[number] for number in range(SIDE * SIDE)] == scene.payloads
        land_whole(url, scene)
        assert not errors(caplog)


def test_the_sdks_cache_on_a_full_disk(small_disk: Path, tmp_path: Path) -> None:
    """Landings go on from memory; the cache keeps what fits, and what it keeps is right."""
    scene = write_grid_scene(tmp_path / "scenes" / "grid", cells=80)
    assert sum(map(len, scene.payloads)) > 3 << 20

    async def work(url: str) -> int:
        async with terraport.connect(url, cache_dir=small_disk / "cache") as session:
            landing = await session.land(CENTRE, 100.0)
            payloads = {segment.id: segment.payload for segment in await landing.ready(20)}
            assert [payloads[number] for number in range(SIDE * SIDE)] == scene.payloads
            return landing.stats.disk_bytes

    with BackgroundServer(tmp_path / "scenes") as service:
        url = f"{service.url}/scenes/grid"
        assert asyncio.run(work(url)) == 0
        kept = asyncio.run(work(url))  # a new session finds what was kept
        assert kept < 3 << 20


def test_a_pack_that_is_deleted_under_the_service(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """What is open stays readable: sessions of now and later ones land as before."""
    scene = write_grid_scene(tmp_path / "scenes" / "grid")
    with BackgroundServer(tmp_path / "scenes", scene_poll_s=0.1) as service:
        url = f"{service.url}/scenes/grid"
        (scene.path / scene.manifest.files["segments.pack"].path).unlink()
        land_whole(url, scene)
    assert not errors(caplog)
    # The next start says what is wrong, and serves the rest without this scene.
    with BackgroundServer(tmp_path / "scenes"):
        eventually(lambda: "scene not opened" in caplog.messages)


@pytest.mark.parametrize("damage", ["a folder in its place", "garbage", "empty"])
def test_a_manifest_that_goes_bad_under_the_service(
    tmp_path: Path, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Nobody publishes like that, but disks and people do it: the version that is open stays."""
    scene = write_grid_scene(tmp_path / "scenes" / "grid")
    manifest = scene.path / "scene.json"
    good = manifest.read_bytes()
    with BackgroundServer(tmp_path / "scenes", scene_poll_s=0.1) as service:
        url = f"{service.url}/scenes/grid"
        if damage == "a folder in its place":
            manifest.unlink()
            manifest.mkdir()
        else:
            manifest.write_bytes(b"{" if damage == "garbage" else b"")
            eventually(lambda: "scene not opened" in caplog.messages)
            land_whole(url, scene)
        if manifest.is_dir():
            manifest.rmdir()
        replaced = manifest.with_name("new")
        replaced.write_bytes(good)
        replaced.replace(manifest)
        eventually(lambda: lands(url, scene))


def lands(url: str, scene: GridScene) -> bool:
    try:
        land_whole(url, scene)
    except AssertionError:
        return False
    return True
