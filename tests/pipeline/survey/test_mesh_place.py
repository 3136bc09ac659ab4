from __future__ import annotations

from pathlib import Path

import pytest

from terraport_pipeline.errors import OptionError, ReadError, SurveyError
from terraport_pipeline.mesh_statement import MeshStatement
from terraport_pipeline.survey.find_mesh import find_mesh
from terraport_pipeline.survey.mesh_place import mesh_place
from terraport_pipeline.survey_statement import SurveyStatement

BODY = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
INFO = """<Model globalCoordinateSystem="+proj=utm +zone=32"
 globalCoordinateSystemName="epsg:32632 - WGS 84 / UTM zone 32N" exportCoordinateSystemType="1">
<transformToModel>{matrix}</transformToModel></Model>
<ModelExport exportBinary="1"/>"""
SHIFTED = "1 0 0 500000 0 1 0 5200000 0 0 1 10 0 0 0 1"
TURNED = "0 0 1 500000 1 0 0 5200000 0 1 0 10 0 0 0 1"


def mesh(folder: Path, text: str = BODY, name: str = "m.obj") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("files", "where", "shift", "epsg"),
    [
        ({}, "m.obj", None, None),
        ({"m.obj.offset.xyz": "1 2 3\n"}, "m.obj", (1, 2, 3), None),
        ({"pit_offset.xyz": "1.5 2 3\n"}, "m.obj", (1.5, 2, 3), None),
        (
            {"1_initial/params/p_offset.xyz": "7 8 9"},
            "2_densification/3d_mesh/p_simplified_3d_mesh.obj", (7, 8, 9), None,
        ),
        (
            {"odm_georeferencing/coords.txt": "WGS84 UTM 15N\n551990 5277512\n1 2 3\n"},
            "odm_texturing/odm_textured_model_geo.obj", (551990, 5277512, 0), 32615,
        ),
        (
            {"odm_georeferencing/odm_georeferencing_model_geo.txt": "WGS84 UTM 19S\n10 20\n"},
            "odm_texturing/m.obj", (10, 20, 0), 32719,
        ),
        ({"m.obj.rcInfo": INFO.format(matrix=SHIFTED)}, "m.obj", (500000, 5200000, 10), 32632),
        ({"m.obj.rsInfo": INFO.format(matrix=SHIFTED)}, "m.obj", (500000, 5200000, 10), 32632),
        (
            {"metadata.xml": "<M><SRS>EPSG:25832</SRS><SRSOrigin>4,5,6</SRSOrigin></M>"},
            "Data/m.obj", (4, 5, 6), 25832,
        ),
        ({"offset.txt": "offset 4 5 6\n"}, "m.obj", (4, 5, 6), None),
    ],
)  # fmt: skip
def test_what_programs_write_beside_a_mesh(
    tmp_path: Path,
    files: dict[str, str],
    where: str,
    shift: tuple[float, ...] | None,
    epsg: int | None,
) -> None:
    path = mesh((tmp_path / where).parent, name=Path(where).name)
    for name, text in files.items():
        mesh((tmp_path / name).parent, text, Path(name).name)
    place = mesh_place(path)
    assert place.shift == shift
    assert (None if place.crs is None else place.crs.to_epsg()) == epsg
    if shift is not None:
        assert place.shift_from in {Path(name).name for name in files}
        assert [file.name for file in place.files] == [Path(name).name for name in files]


def test_comments_of_our_own_export(tmp_path: Path) -> None:
    text = (
        "# pit, version a\n# coordinate reference system: WGS 84 / UTM zone 35S, unit m\n"
        "# global shift (add to x y z): 641128.000 8594754.000 1241.000\n" + BODY
    )
    place = mesh_place(mesh(tmp_path, text))
    assert place.shift == (641128, 8594754, 1241)
    assert place.crs is not None
    assert place.crs.to_epsg() == 32735
    assert place.files == ()


def test_a_turn_is_not_guessed_at(tmp_path: Path) -> None:
    path = mesh(tmp_path)
    mesh(tmp_path, INFO.format(matrix=TURNED), "m.obj.rcInfo")
    with pytest.raises(ReadError, match="turns or scales"):
        mesh_place(path)
    given = find_mesh(
        [path], SurveyStatement(crs="EPSG:32632"), MeshStatement(shift=(0.0, 0.0, 0.0))
    )
    assert given is not None
    assert given.place.shift is None


def test_the_kind_of_input_decides(tmp_path: Path) -> None:
    none, plain = SurveyStatement(), MeshStatement()
    points = mesh(tmp_path, "0 0 0\n1 1 1\n", "p.xyz")
    assert find_mesh([points], none, plain) is None
    body = mesh(tmp_path)
    given = find_mesh([body], none, plain)
    assert given is not None
    assert given.up == "z"
    assert find_mesh([body], none, MeshStatement(as_points=True)) is None
    with pytest.raises(SurveyError, match="expected it alone"):
        find_mesh([body, points], none, plain)
    with pytest.raises(OptionError, match="of meshes alone"):
        find_mesh([points], none, MeshStatement(up="y"))
    with pytest.raises(OptionError, match="which is a mesh"):
        find_mesh([body], SurveyStatement(columns=("x", "y", "z")), plain)
    with pytest.raises(OptionError, match="three finite numbers"):
        MeshStatement(shift=(0.0, float("nan"), 0.0))
