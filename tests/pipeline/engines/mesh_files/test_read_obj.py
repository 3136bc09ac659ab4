from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from payload.images import pillow
from PIL import Image
from store.tiny_scene import lattice_mesh, textured

from terraport.obj import write_obj
from terraport_pipeline.engines.mesh_files.obj_materials import obj_companions
from terraport_pipeline.engines.mesh_files.read_mesh import read_mesh
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


def test_neighbours_over_a_seam_share_their_vertices(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text(
        "newmtl left\nmap_Kd -o 0 0 0 dir/l.jpg\nnewmtl right\nKd 1 0.5 0\n"
    )
    (tmp_path / "l.jpg").write_bytes(pillow("JPEG"))
    mesh = read_obj(write(tmp_path, SEAM))
    left, right = mesh.materials
    assert (left.name, left.image) == ("left", tmp_path / "l.jpg")
    assert (right.name, right.image, right.colour) == ("right", None, (255, 128, 0))
    assert mesh.vertices[0].tolist() == [500000.25, 5200000.5, 1.0]
    assert mesh.faces.tolist() == [[0, 1, 2], [1, 3, 2], [2, 1, 3]]
    assert mesh.material.tolist() == [0, 1, 1]
    assert mesh.line.tolist() == [11, 13, 14]
    assert mesh.wedges is not None
    assert mesh.wedges[0].tolist() == [[0, 1], [1, 1], [0, 0]]  # v counts downwards here
    assert mesh.wedges[2].tolist() == [[0, 1], [1, 1], [0.5, 0.5]]


def test_what_our_own_writer_writes(tmp_path: Path) -> None:
    mesh = textured(lattice_mesh(0, 0, 3), pillow("JPEG"))
    write_obj(mesh, tmp_path / "a.obj")
    read = read_obj(tmp_path / "a.obj")
    assert [material.image for material in read.materials] == [tmp_path / "a.jpg"]
    np.testing.assert_allclose(read.vertices[read.faces], mesh.positions[mesh.faces], rtol=1e-6)
    assert read.wedges is not None
    assert mesh.uvs is not None
    np.testing.assert_allclose(read.wedges, mesh.uvs[mesh.faces], atol=1e-6)


def test_polygons_negative_numbers_and_no_texture(tmp_path: Path) -> None:
    text = "v 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 1 1 0 1 1 1\nv 0 1 0 1 1 1\nf -4//1 -3//1 -2//1 -1//1\n"
    mesh = read_obj(write(tmp_path, text))
    assert mesh.wedges is None
    assert mesh.polygons == 1
    assert mesh.vertices[mesh.faces].tolist() == [
        [[0, 0, 0], [1, 0, 0], [1, 1, 0]],
        [[0, 0, 0], [1, 1, 0], [0, 1, 0]],
    ]


def test_negative_numbers_count_from_where_they_stand(tmp_path: Path) -> None:
    body = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n"
    mesh = read_obj(write(tmp_path, f"o one\n{body}o two\n{body.replace('v 0', 'v 5')}"))
    assert mesh.objects == 2
    assert mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_lines_that_go_on_and_tabs(tmp_path: Path) -> None:
    mesh = read_obj(write(tmp_path, "v 0 0 0\nv\t1 0 0\n  v 0 1 0\nf 1 2 \\\n3\n"))
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert mesh.line.tolist() == [5]


@pytest.mark.parametrize("form", ["{v}", "{v}/{t}", "{v}//{t}", "{v}/{t}/{t}", "mixed"])
def test_even_and_uneven_lines_say_the_same(tmp_path: Path, form: str) -> None:
    head = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nvn 0 0 1\nvn 0 0 1\n"
    forms = ["{v}/{t}", "{v}//{t}"] if form == "mixed" else [form, form]
    lines = ["f " + " ".join(f.format(v=k, t=k) for k in (1, 2, 3)) for f in forms]
    mesh = read_obj(write(tmp_path, head + "\n".join(lines)))
    assert mesh.faces.tolist() == [[0, 1, 2]] * 2
    has_wedge = "/{t}" in forms[0] and "//" not in forms[0]
    assert (mesh.wedges is not None) == has_wedge
    if form == "mixed":
        assert mesh.wedges is not None
        assert np.isnan(mesh.wedges[1]).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no v line"),
        ("v 0 0 0\n", "no face"),
        ("v 0 0\nf 1 1 1\n", "line 1: .*finite numbers"),
        ("v 0 0 0\nv 0 0 nan\nf 1 1 1\n", "line 2: .*'0 0 nan', expected 3 finite numbers"),
        ("v 0 0 x\nf 1 1 1\n", "line 1: .*finite numbers"),
        ("v 0 0 0\nvt 0 inf\nf 1/1 1/1 1/1\n", "line 2: vt"),
        ("v 0 0 0\nf 1 2 1\n", "line 2: .*beyond 1 vertices"),
        ("v 0 0 0\nf 0 1 1\n", "line 2: .*beyond"),
        ("v 0 0 0\nf 1 1 1\nf 1 1 -2\n", "line 3: .*beyond"),
        ("v 0 0 0\nf 1/1 1/1 1/1\n", "0 vt lines"),
        ("v 0 0 0\n\nf 1 a 1\n", "line 3: .*names no number"),
        ("v 0 0 0\nf 1 1\n", "line 2: a face with 2 corners"),
    ],
)
def test_what_is_no_obj(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ReadError, match=message):
        read_obj(write(tmp_path, text))


def test_what_is_missing_is_named_by_line(tmp_path: Path) -> None:
    path = write(tmp_path, SEAM)
    left, _ = read_obj(path).materials
    assert "a.obj at line 1: its material library a.mtl is not beside it" in str(left.missing)
    (tmp_path / "a.mtl").write_text("newmtl left\nmap_Kd ../../etc/l.jpg\n")
    left, right = read_obj(path).materials
    assert "a.mtl at line 2: the texture ../../etc/l.jpg" in str(left.missing)
    assert right.missing is None
    assert [file.name for file in obj_companions(path)] == ["a.mtl"]


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match="no such file"):
        read_obj(tmp_path / "b.obj")


def paint(folder: Path, **colours: tuple[int, int, int]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, colour in colours.items():
        Image.new("RGB", (4, 4), colour).save(folder / f"{name}.png")


PLAIN_OPTIONS = "-clamp on -o 0 0 0 -s 1 1 -mm 0 1"
LEFT_RIGHT = "newmtl left\nmap_Kd l.png\nnewmtl right\nmap_Kd r.png\n"


@pytest.mark.parametrize(
    ("head", "libraries"),
    [
        (
            "mtllib a.mtl b.mtl",
            {"a.mtl": LEFT_RIGHT[:25], "b.mtl": LEFT_RIGHT[25:]},
        ),
        ("mtllib b.mtl\nmtllib a.mtl", {"a.mtl": LEFT_RIGHT}),
        ("mtllib A.MTL", {"a.mtl": LEFT_RIGHT.replace("l.png", "L.PNG")}),
        ("mtllib a.mtl", {"a.mtl": LEFT_RIGHT.replace(" ", "\t").replace("map", "\tmap")}),
        ("mtllib my lib.mtl", {"my lib.mtl": LEFT_RIGHT}),
        ('mtllib "a.mtl"', {"a.mtl": LEFT_RIGHT.replace("l.png", '"l.png"')}),
        ("mtllib a.mtl", {"a.mtl": LEFT_RIGHT.replace("l.png", "C:\\out\\tex\\L.png")}),
        ("mtllib .\\a.mtl", {"a.mtl": LEFT_RIGHT.replace("\n", "\r\n")}),
        ("mtllib a.mtl", {"a.mtl": LEFT_RIGHT.replace("newmtl left", "newmtl LEFT")}),
        ("mtllib a.mtl", {"a.mtl": LEFT_RIGHT.replace("l.png", f"{PLAIN_OPTIONS} l.png")}),
    ],
)  # fmt: skip
def test_libraries_and_images_as_programs_name_them(
    tmp_path: Path, head: str, libraries: dict[str, str]
) -> None:
    paint(tmp_path, l=(200, 30, 30), r=(30, 30, 200))
    for name, text in libraries.items():
        (tmp_path / name).write_bytes(text.encode())
    path = write(tmp_path, SEAM.replace("mtllib a.mtl", head))
    left, right = read_obj(path).materials
    assert (left.image, right.image) == (tmp_path / "l.png", tmp_path / "r.png")
    assert {f.name for f in obj_companions(path)} == {*libraries, "l.png", "r.png"}


def test_a_library_after_the_faces_and_a_name_with_decomposed_accents(tmp_path: Path) -> None:
    paint(tmp_path / "tex", l=(9, 9, 9))
    (tmp_path / "tex" / "l.png").rename(tmp_path / "tex" / "Bru\u0308cke.png")
    (tmp_path / "a.mtl").write_text("newmtl left\nmap_Kd tex/Br\u00fccke.png\n", encoding="utf-8")
    path = write(tmp_path, SEAM.replace("mtllib a.mtl\n", "") + "mtllib a.mtl\n")
    assert read_obj(path).materials[0].image == tmp_path / "tex" / "Bru\u0308cke.png"


def test_names_of_older_programs_on_windows(tmp_path: Path) -> None:
    paint(tmp_path, l=(9, 9, 9))
    (tmp_path / "l.png").rename(tmp_path / "Fl\u00e4che.png")
    text = "newmtl S\u00fcd\nmap_Kd Fl\u00e4che.png\n"
    (tmp_path / "a.mtl").write_bytes(text.encode("cp1252"))
    path = tmp_path / "a.obj"
    path.write_bytes(SEAM.replace("usemtl left", "usemtl S\u00fcd").encode("cp1252"))
    assert read_obj(path).materials[0].image == tmp_path / "Fl\u00e4che.png"


def test_an_image_that_is_scaled_or_cut_out_is_not_taken_as_it_is(tmp_path: Path) -> None:
    paint(tmp_path, l=(9, 9, 9))
    text = "newmtl left\nmap_Kd -s 2 2 1 l.png\nnewmtl right\nmap_Kd l.png\nmap_d m.png\n"
    (tmp_path / "a.mtl").write_text(text)
    path = write(tmp_path, SEAM.replace(".25 52", ".33 52"))
    left, _ = read_obj(path).materials
    assert left.image is None
    assert "a.mtl at line 2: the texture -s 2 2 1 l.png of material left" in str(left.missing)
    assert "drawn opaque (material right)" in read_mesh(path).warnings[-1]


CORNER = "v {} {} 0{}\n"


@pytest.mark.parametrize(
    ("more", "read"),
    [
        ([" 0.8 0.1 0.1", "", " 0 0 1"], [[204, 26, 26], [128] * 3, [0, 0, 255]]),
        (["", " 200 30 30", " 1.0"], [[128] * 3, [200, 30, 30], [128] * 3]),
        ([" 0 0.2 0.4 1", " 1 0 0 1", " 0 1 0 1"], [[0, 51, 102], [255, 0, 0], [0, 255, 0]]),
        ([" 1 0 0.2 0.4", " 1 1 0 0", " 1 0 1 0"], [[0, 51, 102], [255, 0, 0], [0, 255, 0]]),
    ],
)
def test_colours_on_some_lines_beside_weights_and_with_alpha(
    tmp_path: Path, more: list[str], read: list[list[int]]
) -> None:
    places = [(0, 0), (1, 0), (1, 1)]
    text = "".join(CORNER.format(*at, end) for at, end in zip(places, more, strict=True))
    mesh = read_mesh(write(tmp_path, f"{text}f 1 2 3\n"))
    assert mesh.colours is not None
    assert mesh.colours.tolist() == read
    grey = read.count([128] * 3)
    assert [f"{grey} of 3 vertices" in text for text in mesh.warnings] == [True] * (grey > 0)


@pytest.mark.parametrize("more", [" 1 0.5 0.5 1", " 0 0.5 0.5 0.5", " 0 0 300", " 1 2 3 4 5"])
def test_colours_of_two_meanings_or_none(tmp_path: Path, more: str) -> None:
    text = "".join(CORNER.format(*at, more) for at in ((0, 0), (1, 0), (1, 1)))
    with pytest.raises(ReadError, match="expected"):
        read_mesh(write(tmp_path, f"{text}f 1 2 3\n"))


@pytest.mark.parametrize(
    ("form", "words"),
    [
        ("{:.3f}", None),
        ("{:.0f}", None),  # whole metres are what was meant, as far as can be told
        ("{:g}", "in six digits .*steps of 10 m"),
        ("{:.7g}", None),
    ],
)
def test_large_coordinates_in_few_digits_are_told(
    tmp_path: Path, form: str, words: str | None
) -> None:
    places = [(500_000.37, 4_512_345.61), (500_003.1, 4_512_345.9), (500_002.2, 4_512_377.3)]
    text = "".join(f"v {form.format(x)} {form.format(y)} 3.25\n" for x, y in places)
    found = read_mesh(write(tmp_path, f"{text}f 1 2 3\n")).warnings
    assert bool(found) == bool(words)
    assert words is None or re.search(words, found[0])


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
    mesh = read_obj(path)
    assert mesh.wedges is not None
    np.testing.assert_allclose(mesh.vertices[mesh.faces], vertices[faces - 1])
    upwards = mesh.wedges * [1, -1] + [0, 1]
    np.testing.assert_allclose(upwards, uvs[wedges - 1], atol=1e-6)


@pytest.mark.parametrize(
    ("written", "read"), [("0 0.5 1.001", [0, 128, 255]), ("0 128 255", [0, 128, 255])]
)
def test_colours_of_vertices_as_shares_or_as_bytes(
    tmp_path: Path, written: str, read: list[int]
) -> None:
    corners = [f"v {x} {y} 0 {written}" for x, y in ((0, 0), (1, 0), (1, 1))]
    (tmp_path / "a.obj").write_text("\n".join([*corners, "f 1 2 3", ""]))
    mesh = read_obj(tmp_path / "a.obj")
    assert mesh.colours is not None
    assert mesh.colours.tolist() == [read] * 3
