"""Where scenes lie: what a look sees, and what it makes of what it cannot see."""

from __future__ import annotations

import shutil
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import pytest
from s3_servers import s3_environment
from server.grid_scene import write_grid_scene

from terraport_server.errors import SettingsError
from terraport_server.limits import DEFAULT_LIMITS
from terraport_server.scenes.roots import ObjectRoot, SceneRoot, root_of
from terraport_server.settings import Settings
from terraport_store import OriginError
from terraport_store.object_files import ObjectStorage
from terraport_store.origin import ObjectOptions, Origin


class Moody(Origin):
    """An origin that can be told not to answer."""

    silent: ClassVar[set[str]] = set()

    def head(self, path: str):  # type: ignore[no-untyped-def]
        if any(word in f"{self.url}/{path}" for word in self.silent):
            raise OriginError(self.url, "said nothing")
        return super().head(path)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name in ("pit", "well"):
        write_grid_scene(tmp_path / "scenes" / name, cells=2)
    return tmp_path / "scenes"


@pytest.fixture
def object_root(root: Path) -> Iterator[ObjectRoot]:
    Moody.silent = set()
    in_storage = ObjectRoot(
        f"file://{root}",
        ObjectStorage(make_origin=lambda url: Moody(url, ObjectOptions(timeout_s=1.0))),
    )
    yield in_storage
    in_storage.close()


def test_a_folder_and_an_address_show_the_same_scenes(root: Path, object_root: ObjectRoot) -> None:
    assert list(SceneRoot(root).look()) == list(object_root.look()) == ["pit", "well"]


def test_what_says_nothing_is_as_before(object_root: ObjectRoot) -> None:
    before = object_root.look()
    Moody.silent = {"/pit"}
    for _ in range(3):
        assert object_root.look() == before


def test_what_is_gone_for_two_looks_is_gone(root: Path, object_root: ObjectRoot) -> None:
    assert list(object_root.look()) == ["pit", "well"]
    shutil.rmtree(root / "pit")
    assert list(object_root.look()) == ["pit", "well"]
    assert list(object_root.look()) == ["well"]
    write_grid_scene(root / "pit", cells=2)
    assert list(object_root.look()) == ["pit", "well"]


def test_a_root_that_says_nothing_is_an_error(object_root: ObjectRoot) -> None:
    Moody.silent = {"scenes/scene.json"}
    with pytest.raises(OriginError):
        object_root.look()


def test_storage_that_never_answers_is_said_within_seconds(tmp_path: Path) -> None:
    """A service is started by a person who waits; a landing's patience is another."""
    with socket.create_server(("127.0.0.1", 0)) as silent, s3_environment():
        endpoint = f"http://127.0.0.1:{silent.getsockname()[1]}"  # takes connections, says nothing
        options = ObjectOptions(endpoint=endpoint)
        in_storage = ObjectRoot("s3://bucket/scenes", ObjectStorage(options))
        began_s = time.monotonic()
        with pytest.raises(OriginError, match=r"s3://bucket/scenes/scene\.json: .* tr(y|ies) in"):
            in_storage.look()
        assert time.monotonic() - began_s < 6.0
        in_storage.close()


def test_settings_name_the_root(root: Path, tmp_path: Path) -> None:
    assert type(root_of(Settings(scenes_dir=root), DEFAULT_LIMITS)) is SceneRoot
    named = root_of(
        Settings(scenes_url=f"file://{root}", object_cache_dir=tmp_path / "cache"), DEFAULT_LIMITS
    )
    assert isinstance(named, ObjectRoot)
    assert named.ahead_bytes == 8 << 20
    assert list(named.look()) == ["pit", "well"]
    named.close()


def test_a_cache_that_cannot_be_written_is_refused(root: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(SettingsError, match=r"object_cache_dir: .* object_cache_bytes = 0"):
        root_of(
            Settings(scenes_url="file:///x", object_cache_dir=tmp_path / "file" / "cache"),
            DEFAULT_LIMITS,
        )


def test_an_address_must_be_one() -> None:
    with pytest.raises(SettingsError, match="scenes_url: got 'scenes', expected an address"):
        Settings(scenes_url="scenes").check()
