from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from payload.images import pillow
from store.tiny_scene import lattice_mesh, textured

from terraport.errors import UsageError
from terraport.mesh import to_trimesh
from terraport.obj import write_obj


def test_a_textured_mesh_comes_back_with_its_image(tmp_path: Path) -> None:
    mesh = textured(lattice_mesh(0, 0, 3), pillow("JPEG"))
    size = write_obj(mesh, tmp_path / "a.obj")
    files = {path.name: path.stat().st_size for path in tmp_path.iterdir()}
    assert set(files) == {"a.obj", "a.mtl", "a.jpg"}
    assert size == sum(files.values())
    assert (tmp_path / "a.jpg").read_bytes() == pillow("JPEG")
    loaded = trimesh.load(tmp_path / "a.obj", process=False)
    np.testing.assert_allclose(loaded.triangles, mesh.positions[mesh.faces], rtol=1e-6, atol=1e-6)
    assert mesh.uvs is not None
    upwards = np.column_stack([mesh.uvs[:, 0], 1 - mesh.uvs[:, 1]])
    np.testing.assert_allclose(loaded.visual.uv[loaded.faces], upwards[mesh.faces], atol=1e-6)
    assert loaded.visual.material.image.size == (16, 8)


def test_a_coloured_mesh_has_its_colours_behind_the_positions(tmp_path: Path) -> None:
    mesh = lattice_mesh(0, 0, 3)
    write_obj(mesh, tmp_path / "a.obj")
    assert [path.name for path in tmp_path.iterdir()] == ["a.obj"]
    loaded = trimesh.load(tmp_path / "a.obj", process=False)
    assert mesh.colours is not None
    assert np.abs(loaded.visual.vertex_colors[:, :3].astype(int) - mesh.colours).max() <= 1


def test_what_is_no_obj(tmp_path: Path) -> None:
    mesh = lattice_mesh(0, 0, 3)
    with pytest.raises(UsageError, match=r"expected \.obj"):
        write_obj(mesh, tmp_path / "a.glb")
    with pytest.raises(UsageError, match="0 faces"):
        write_obj(replace(mesh, faces=mesh.faces[:0]), tmp_path / "a.obj")


def test_trimesh_has_the_texture_the_same_way_up() -> None:
    mesh = textured(lattice_mesh(0, 0, 3), pillow("PNG"))
    converted = to_trimesh(mesh)
    assert mesh.uvs is not None
    np.testing.assert_allclose(converted.visual.uv[:, 1], 1 - mesh.uvs[:, 1], atol=1e-7)
    assert converted.visual.material.baseColorTexture.size == (16, 8)
    exported = trimesh.load(
        trimesh.util.wrap_as_stream(converted.export(file_type="glb")),
        file_type="glb",
        process=False,
    )
    (back,) = exported.geometry.values()
    np.testing.assert_allclose(back.visual.uv, converted.visual.uv, atol=1e-6)
