"""A scene with textures, streamed: nothing on the way knows of them, and everything arrives."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import pytest
import trimesh
from glb_file import read_glb
from payload.images import pillow
from store.tiny_scene import TinyScene, write_tiny_scene

import terraport
from terraport.cli import app
from terraport_payload import Texture
from terraport_server import BackgroundServer


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> TinyScene:
    """Four segments, two with texture."""
    folder = tmp_path_factory.mktemp("textures")
    return write_tiny_scene(folder / "tiny", image=pillow("JPEG", 64, 32))


@pytest.fixture(scope="module")
def server(tiny: TinyScene) -> Iterator[BackgroundServer]:
    """Serves it."""
    with BackgroundServer(tiny.path.parent) as running:
        yield running


def test_segments_arrive_with_their_images(server: BackgroundServer, tiny: TinyScene) -> None:
    with terraport.sync.connect(server.scene_url("tiny")) as session:
        landing = session.land((1.0, 1.0, -1.0), radius_m=50.0)
        segments = {segment.id: segment.arrays() for segment in landing.ready()}
        base = session.base()
    assert len(segments) == 4
    image = Texture.of(pillow("JPEG", 64, 32))
    for number, mesh in segments.items():
        assert (mesh.texture == image) is (number % 2 == 0)
        assert (mesh.colours is None) is (number % 2 == 0)
    assert base.mesh.texture == image
    drawn = terraport.mixed_model(base, segments, landing.hidden_faces)
    assert drawn.colours is not None  # some with textures, some with colours: all have colours


def test_a_landing_is_written_with_its_texture(
    server: BackgroundServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.glb", "a.obj"):
        with pytest.raises(SystemExit) as exit_:
            app(
                ["land", server.scene_url("tiny"), "1", "1", "-1", "--radius", "0.2",
                 "--glb", str(tmp_path / name)],
                prog_name="terraport",
            )  # fmt: skip
        assert not exit_.value.code, capsys.readouterr().err
    mesh = read_glb((tmp_path / "a.glb").read_bytes())
    assert mesh.texture is not None
    loaded = trimesh.load(io.BytesIO((tmp_path / "a.obj").read_bytes()), file_type="obj")
    assert len(loaded.faces) == len(mesh.faces)
    assert (tmp_path / "a.jpg").read_bytes() == mesh.texture.data
