from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from terraport_pipeline.engines.mesh_files.read_mesh import read_mesh
from terraport_pipeline.errors import ReadError

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 2]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3], [0, 1, 4]])
COLOURS = np.array([[10, 20, 30], [40, 50, 60], [70, 80, 90], [1, 2, 3], [200, 210, 220]], np.uint8)


POINT = (
    b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
    b"property float z\nend_header\n0 0 0\n"
)


def plate() -> trimesh.Trimesh:
    return trimesh.Trimesh(CORNERS, FACES, vertex_colors=COLOURS, process=False)


@pytest.mark.parametrize("kind", ["off", "ply", "obj", "stl", "glb"])
def test_every_format_keeps_triangles_in_order_and_neighbours(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a.{kind}"
    plate().export(path)
    mesh = read_mesh(path)
    np.testing.assert_allclose(mesh.vertices[mesh.faces], CORNERS[FACES])
    assert len(mesh.vertices) == 5  # an STL has nine, at five places
    if kind in ("ply", "obj", "glb"):
        assert mesh.colours is not None
        place = [int(np.flatnonzero((mesh.vertices == corner).all(1))[0]) for corner in CORNERS]
        np.testing.assert_array_equal(mesh.colours[place], COLOURS)
        assert mesh.origin_of_colours == "vertices"
    else:
        assert mesh.colours is None


@pytest.mark.parametrize("kind", ["ply", "glb"])
def test_attributes_by_name(tmp_path: Path, kind: str) -> None:
    mesh = plate()
    mesh.vertex_attributes["_grade" if kind == "glb" else "grade"] = np.arange(5, dtype=np.float32)
    if kind == "ply":
        mesh.face_attributes["part"] = np.array([3, 1, 2])
    mesh.export(tmp_path / f"a.{kind}")
    read = read_mesh(tmp_path / f"a.{kind}")
    assert sorted(read.attributes) == (["grade", "part"] if kind == "ply" else ["grade"])
    assert read.attributes["grade"].tolist() == [0, 1, 2, 3, 4]


def test_nodes_of_a_glb_stand_where_it_says(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for shift in (0.0, 5.0):
        moved = np.eye(4)
        moved[0, 3] = shift
        scene.add_geometry(plate(), transform=moved)
    scene.export(tmp_path / "a.glb")
    mesh = read_mesh(tmp_path / "a.glb")
    assert len(mesh.faces) == 6
    assert np.ptp(mesh.vertices[:, 0]) == 6.0


TEXTURED = """mtllib a.mtl
v 500000 5200000 1
v 500001 5200000 1
v 500000 5200001 1
v 500001 5200001 1
vt 0 0
vt 1 0
vt 0 1
vt 0.9 0.9
usemtl left
f 1/1 2/2 3/3
usemtl right
f 2/2 4/4 3/3
usemtl left
f 1/1 3/3 4/4
"""


def test_a_textured_obj_by_its_wedges(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(TEXTURED)
    (tmp_path / "a.mtl").write_text("newmtl left\nmap_Kd l.png\nnewmtl right\nmap_Kd r.png\n")
    for name, rows in (("l", [[255, 0, 0], [0, 255, 0]]), ("r", [[0, 0, 255], [0, 0, 255]])):
        image = np.repeat(np.array(rows, np.uint8)[:, None], 2, axis=1)
        Image.fromarray(image).save(tmp_path / f"{name}.png")
    mesh = read_mesh(tmp_path / "a.obj")
    # In the file's order, though left is one material and right another; seams touch again.
    assert len(mesh.vertices) == 4
    assert mesh.vertices[mesh.faces[:, 1]].tolist() == [
        [500001, 5200000, 1], [500001, 5200001, 1], [500000, 5200001, 1],
    ]  # fmt: skip
    assert mesh.origin_of_colours == "texture"
    assert mesh.colours is not None
    places = (mesh.vertices - [500000, 5200000, 1]).astype(int).tolist()
    at = dict(zip(map(tuple, places), mesh.colours.tolist(), strict=True))
    # v counts from below: (0, 0) is the lower row, green.
    assert at[0, 0, 0] == [0, 255, 0]
    assert at[1, 0, 0] == [0, 128, 128]  # green in left, blue in right
    assert at[0, 1, 0] == [170, 0, 85]  # red in two faces of left, blue in right


def test_a_textured_glb(tmp_path: Path) -> None:
    image = Image.fromarray(np.array([[[255, 0, 0], [0, 0, 255]]], np.uint8))
    visual = trimesh.visual.TextureVisuals(
        uv=[[0.1, 0.5], [0.9, 0.5], [0.9, 0.1], [0.1, 0.9], [0.9, 0.9]],
        material=trimesh.visual.material.PBRMaterial(baseColorTexture=image),
    )
    trimesh.Trimesh(CORNERS, FACES, visual=visual, process=False).export(tmp_path / "a.glb")
    mesh = read_mesh(tmp_path / "a.glb")
    assert mesh.colours is not None
    red, blue = [255, 0, 0], [0, 0, 255]
    assert mesh.colours.tolist() == [red, blue, blue, red, blue]


def test_colours_of_faces_become_those_of_vertices(tmp_path: Path) -> None:
    mesh = trimesh.Trimesh(CORNERS, FACES[:2], face_colors=[[100, 0, 0], [0, 100, 0]],
                           process=False)  # fmt: skip
    mesh.export(tmp_path / "a.ply")
    read = read_mesh(tmp_path / "a.ply")
    assert read.origin_of_colours == "faces"
    assert read.colours is not None
    assert read.colours[1].tolist() == [100, 0, 0]
    assert read.colours[0].tolist() == [50, 50, 0]


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.xyz", b"", "expected .off, .ply"),
        ("a", b"", "its ending is missing"),
        ("a.off", None, "no such file"),
        ("a.off", b"OFF\n1 x", "cannot be read"),
        ("a.glb", b"glTF", "begin as a GLB"),
        ("a.ply", POINT, "terraport build"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\nnan 1 0\n3 0 1 2\n", "expected numbers|cannot"),
    ],
)  # fmt: skip
def test_what_is_no_mesh(tmp_path: Path, name: str, data: bytes | None, message: str) -> None:
    if data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(ReadError, match=message):
        read_mesh(tmp_path / name)


def test_an_image_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(TEXTURED)
    (tmp_path / "a.mtl").write_text("newmtl left\nmap_Kd l.png\n")
    (tmp_path / "l.png").write_bytes(io.BytesIO(b"no image").getvalue())
    with pytest.raises(ReadError, match=r"l\.png"):
        read_mesh(tmp_path / "a.obj")


PLY_SQUARE = """ply
format ascii 1.0
{comment}element vertex 4
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
property float s
property float t
element face 2
property list uchar int vertex_indices
end_header
0 0 0 10 90 30 0 0
1 0 0 10 90 30 1 0
1 1 0 10 90 30 1 1
0 1 0 10 90 30 0 1
3 0 1 2
3 0 2 3
"""


def test_a_ply_with_texture_coordinates_has_its_image_or_its_own_colours(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text(PLY_SQUARE.format(comment=""))
    mesh = read_mesh(path)
    assert mesh.colours is not None
    assert mesh.colours.tolist() == [[10, 90, 30]] * 4
    path.write_text(PLY_SQUARE.format(comment="comment TextureFile Skin.png\n"))
    assert "texture Skin.png is not beside it" in str(read_mesh(path).missing)
    Image.new("RGB", (4, 4), (200, 100, 50)).save(tmp_path / "skin.PNG", "PNG")
    mesh = read_mesh(path)
    assert mesh.colours is not None
    assert (mesh.missing, mesh.colours.tolist()) == (None, [[200, 100, 50]] * 4)
    twice = "comment TextureFile Skin.png\ncomment TextureFile b.png\n"
    path.write_text(PLY_SQUARE.format(comment=twice))
    with pytest.raises(ReadError, match="2 textures"):
        read_mesh(path)


@pytest.mark.parametrize("kind", ["stl", "ply"])
def test_large_coordinates_in_32_bits_are_told(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a.{kind}"
    moved = CORNERS + np.array([300_000.25, 6_500_000.75, 12.0])
    trimesh.Trimesh(moved, FACES, process=False).export(path)
    [text] = read_mesh(path).warnings
    assert "steps of 0.5 m" in text


@pytest.mark.parametrize(
    ("mode", "value", "read"),
    [
        ("I;16", 40_000, [156] * 3),
        ("L", 40, [40] * 3),
        ("LA", (70, 9), [70] * 3),
        ("P", 0, [0] * 3),
    ],
)
def test_pixels_of_textures(tmp_path: Path, mode: str, value: object, read: list[int]) -> None:
    text = TEXTURED.replace("usemtl right\n", "")
    (tmp_path / "a.obj").write_text(text)
    for kind in ("png", "tif"):
        if (mode, kind) == ("LA", "tif"):
            continue
        (tmp_path / "a.mtl").write_text(f"newmtl left\nmap_Kd l.{kind}\n")
        Image.new(mode, (4, 4), value).save(tmp_path / f"l.{kind}")  # type: ignore[arg-type]
        mesh = read_mesh(tmp_path / "a.obj")
        assert mesh.colours is not None
        assert mesh.colours.tolist() == [read] * 4


@pytest.mark.parametrize("mode", ["F", "I"])
def test_textures_of_numbers_are_refused(tmp_path: Path, mode: str) -> None:
    (tmp_path / "a.obj").write_text(TEXTURED.replace("usemtl right\n", ""))
    (tmp_path / "a.mtl").write_text("newmtl left\nmap_Kd l.tif\n")
    Image.new(mode, (4, 4), 70_000).save(tmp_path / "l.tif")
    with pytest.raises(ReadError, match=r"l\.tif cannot be read: .*32 bits"):
        read_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize(
    ("kind", "names", "values", "read"),
    [
        ("uchar", "red green blue", "204 26 0", [204, 26, 0]),
        ("ushort", "red green blue", "52428 6682 0", [204, 26, 0]),
        ("ushort", "red green blue", "204 26 0", [204, 26, 0]),
        ("float", "red green blue", "0.8 0.1 0", [204, 26, 0]),
        ("double", "red green blue alpha", "0.8 0.1 0 1", [204, 26, 0]),
        ("float", "red green blue", "204 26 0", [204, 26, 0]),
        ("uchar", "diffuse_red diffuse_green diffuse_blue", "204 26 0", [204, 26, 0]),
        ("int", "r g b", "204 26 0", [204, 26, 0]),
        ("uint", "red green blue", "70000 0 0", None),
    ],
)
@pytest.mark.parametrize("element", ["vertex", "face"])
def test_colours_of_a_ply_in_any_depth(
    tmp_path: Path, element: str, kind: str, names: str, values: str, read: list[int] | None
) -> None:
    columns = "".join(f"property {kind} {name}\n" for name in names.split())
    of_vertex, of_face = (columns, "") if element == "vertex" else ("", columns)
    on_vertex, on_face = (values, "") if element == "vertex" else ("", values)
    text = (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        f"property float z\n{of_vertex}element face 1\n"
        f"property list uchar int vertex_indices\n{of_face}end_header\n"
    )
    text += "".join(f"{x} {y} 0 {on_vertex}\n" for x, y in ((0, 0), (1, 0), (1, 1)))
    (tmp_path / "a.ply").write_text(f"{text}3 0 1 2 {on_face}\n")
    if read is None:
        with pytest.raises(ReadError, match="a colour of 70000"):
            read_mesh(tmp_path / "a.ply")
        return
    mesh = read_mesh(tmp_path / "a.ply")
    assert mesh.colours is not None
    assert mesh.colours.tolist() == [read] * 3
    assert mesh.attributes == {}
