from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from payload.images import pillow
from store.tiny_scene import lattice_mesh, textured

from terraport.obj import write_obj
from terraport_pipeline.engines.mesh_files.read_obj import read_obj
from terraport_pipeline.errors import ReadError

SEAM = """mtllib a.mtl
v 500000.25 5200000.5 1
v 500001 5200000 1
v 500000 5200001 1
v 500001 5200001 1
vt 0 0
vt 1 0
vt 0 1
vt 0.5 0.5
usemtl left
f 1/1 2/2 3/3
usemtl right
f 2/2 4/4 3/3
f 3/1 2/2 4/4
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "a.obj"
    path.write_text(text)
    return path


def test_vertices_are_split_at_seams_and_materials_apart(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl left\nmap_Kd -o 0 0 0 dir/l.jpg\nnewmtl right\n")
    (tmp_path / "l.jpg").write_bytes(pillow("JPEG"))
    left, right = read_obj(write(tmp_path, SEAM))
    assert (left.material, left.image) == ("left", tmp_path / "l.jpg")
    assert (right.material, right.image) == ("right", None)
    assert left.vertices[0].tolist() == [500000.25, 5200000.5, 1.0]
    assert left.uvs is not None
    assert left.uvs.tolist() == [[0, 1], [1, 1], [0, 0]]  # v counts downwards here
    assert right.faces.tolist() == [[0, 1, 2], [3, 0, 1]]
    assert right.vertices[2].tolist() == right.vertices[3].tolist()


def test_what_our_own_writer_writes(tmp_path: Path) -> None:
    mesh = textured(lattice_mesh(0, 0, 3), pillow("JPEG"))
    write_obj(mesh, tmp_path / "a.obj")
    (piece,) = read_obj(tmp_path / "a.obj")
    assert piece.image == tmp_path / "a.jpg"
    np.testing.assert_allclose(piece.vertices[piece.faces], mesh.positions[mesh.faces], rtol=1e-6)
    assert piece.uvs is not None
    assert mesh.uvs is not None
    np.testing.assert_allclose(piece.uvs[piece.faces], mesh.uvs[mesh.faces], atol=1e-6)


def test_polygons_negative_numbers_and_no_texture(tmp_path: Path) -> None:
    text = "v 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 1 1 0 1 1 1\nv 0 1 0 1 1 1\nf -4//1 -3//1 -2//1 -1//1\n"
    (piece,) = read_obj(write(tmp_path, text))
    assert piece.uvs is None
    assert piece.vertices[piece.faces].tolist() == [
        [[0, 0, 0], [1, 0, 0], [1, 1, 0]],
        [[0, 0, 0], [1, 1, 0], [0, 1, 0]],
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no v line"),
        ("v 0 0 0\n", "no face"),
        ("v 0 0\nf 1 1 1\n", "finite numbers"),
        ("v 0 0 nan\nf 1 1 1\n", "finite numbers"),
        ("v 0 0 x\nf 1 1 1\n", "holds no number"),
        ("v 0 0 0\nf 1 2 1\n", "beyond 1 vertices"),
        ("v 0 0 0\nf 1/1 1/1 1/1\n", "0 vt lines"),
        ("v 0 0 0\nf 1 a 1\n", "names no number"),
    ],
)
def test_what_is_no_obj(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ReadError, match=message):
        read_obj(write(tmp_path, text))


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match="no such file"):
        read_obj(tmp_path / "b.obj")


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_every_corner_keeps_its_place_and_its_uv(
    seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    rng = np.random.default_rng(seed)
    vertices, uvs = rng.normal(size=(8, 3)).round(3), rng.integers(0, 4, (6, 2)) / 4
    faces = np.array([rng.permutation(8)[:3] for _ in range(12)]) + 1
    wedges = rng.integers(1, 7, (12, 3))
    text = "".join(
        [f"v {x} {y} {z}\n" for x, y, z in vertices]
        + [f"vt {u} {v}\n" for u, v in uvs]
        + [
            "f " + " ".join(f"{a}/{b}" for a, b in zip(f, w, strict=True)) + "\n"
            for f, w in zip(faces, wedges, strict=True)
        ]
    )
    path = write(tmp_path_factory.mktemp("obj"), text)
    (piece,) = read_obj(path)
    assert piece.uvs is not None
    np.testing.assert_allclose(piece.vertices[piece.faces], vertices[faces - 1])
    upwards = piece.uvs[piece.faces] * [1, -1] + [0, 1]
    np.testing.assert_allclose(upwards, uvs[wedges - 1], atol=1e-6)
