"""A mesh that was reconstructed elsewhere becomes a scene, by the flow that surveys take."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from terraport_payload.types import Float64, Int32, UInt8
from terraport_pipeline.engines.mesh_files.read_mesh import read_mesh
from terraport_pipeline.errors import OptionError, PipelineError, ReadError, SurveyError
from terraport_pipeline.mesh_inspection import inspect_mesh
from terraport_pipeline.mesh_statement import MeshStatement
from terraport_pipeline.options import regions as segment
from terraport_pipeline.options.texturing import Texturing
from terraport_pipeline.report.scene_colour import SceneColour
from terraport_pipeline.stages import texture
from terraport_pipeline.survey.find_mesh import find_mesh
from terraport_pipeline.survey_statement import SurveyStatement
from terraport_pipeline.validate.handoff import HandOffOptions
from terraport_pipeline.validate.validation import ValidationOptions, validate
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_store import Scene

SIDE = 24
PIXELS = 256


def hill() -> tuple[Float64, Int32]:
    """Cells of one metre; vertices (25 * 25, 3) easting, northing, height."""
    x, y = np.meshgrid(np.arange(SIDE + 1.0), np.arange(SIDE + 1.0))
    z = 3.0 * np.exp(-((x - 12) ** 2 + (y - 10) ** 2) / 40)
    at = np.arange((SIDE + 1) ** 2).reshape(SIDE + 1, -1)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([c, b, d], axis=1)])
    return np.stack([x, y, z], axis=2).reshape(-1, 3), faces.astype(np.int32)


def painting(seed: int) -> UInt8:
    """Smooth, so that every place of it is told from the others."""
    rng = np.random.default_rng(seed)
    small = Image.fromarray(rng.integers(30, 220, (6, 6, 3)).astype(np.uint8))
    return np.asarray(small.resize((PIXELS, PIXELS), Image.Resampling.BICUBIC))


def write_model(folder: Path) -> Path:
    """Two materials with an image each: west and east, wedges upright, one vt a vertex a side."""
    folder.mkdir(parents=True, exist_ok=True)
    vertices, faces = hill()
    for name, seed in (("west", 1), ("east", 2)):
        Image.fromarray(painting(seed)).save(folder / f"{name}.png")
    (folder / "model.mtl").write_text("newmtl west\nmap_Kd west.png\nnewmtl east\nmap_Kd east.png")
    half = SIDE / 2
    lines = ["mtllib model.mtl", *(f"v {x:g} {y:g} {z:.6f}" for x, y, z in vertices)]
    lines += [f"vt {x / half:.6f} {y / SIDE:.6f}" for x, y, _ in vertices]
    lines += [f"vt {x / half - 1:.6f} {y / SIDE:.6f}" for x, y, _ in vertices]
    east = vertices[faces].mean(axis=1)[:, 0] > half
    for name, side in (("west", ~east), ("east", east)):
        lines.append(f"usemtl {name}")
        for face in faces[side] + 1:
            shift = len(vertices) * (name == "east")
            lines.append("f " + " ".join(f"{v}/{v + shift}" for v in face))
    (folder / "model.obj").write_text("\n".join(lines) + "\n")
    (folder / "model_offset.xyz").write_text("500000 5200000 100\n")
    return folder / "model.obj"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("mesh")
    model = write_model(folder)
    options = BuildOptions(
        model,
        folder / "scene",
        statement=SurveyStatement(crs="EPSG:32632"),
        segment=segment.Options(max_extent_m=10.0),
        base_texture=256,
    )
    report = build(options)
    assert report.published
    assert [stage.name for stage in report.stages] == [
        "read-mesh", "reconstruct", "segment", "texture", "pack",
    ]  # fmt: skip
    again = build(options)
    assert not again.published
    assert all(stage.taken_up for stage in again.stages)
    return model, folder / "scene"


def test_the_scene_is_the_mesh_face_for_face(built: tuple[Path, Path]) -> None:
    model, path = built
    given = read_mesh(model)
    with Scene.open(path) as scene:
        manifest = scene.manifest
        assert manifest.counts.detail_faces == len(given.faces)
        assert manifest.counts.points == len(given.vertices)
        assert manifest.crs is not None
        assert manifest.crs.epsg == 32632
        assert manifest.origin == (500012.0, 5200012.0, 100.0)
        assert manifest.counts.segments > 4
        assert manifest.textures is not None
        assert manifest.textures.source == "mesh"
        assert str(SceneColour.of(manifest)) == "from the images of the mesh, as textures"
        assert manifest.build.options["mesh"] == {"up": "z"}
        detail = [scene.mesh(i) for i in range(manifest.counts.segments)]
    centres = np.concatenate([mesh.positions[mesh.faces].mean(axis=1) for mesh in detail])
    got = np.sort(centres, axis=0)
    want = given.vertices[given.faces].mean(axis=1) - [12, 12, 0]
    want = np.sort(np.stack([want[:, 0], want[:, 2], -want[:, 1]], axis=1), axis=0)
    np.testing.assert_allclose(got, want, atol=2e-3)


def test_no_ray_finds_a_hole(built: tuple[Path, Path]) -> None:
    found = validate(built[1], ValidationOptions(hand_off=HandOffOptions(rays=20_000)))
    assert found.hand_off is not None
    assert found.problems == 0


def test_texels_are_those_of_the_mesh(built: tuple[Path, Path]) -> None:
    """Colour of every face's middle in the scene's atlases against the images that came in."""
    _, path = built
    paintings = {"west": painting(1).astype(float), "east": painting(2).astype(float)}
    differences = []
    with Scene.open(path) as scene:
        for row in range(scene.manifest.counts.segments):
            mesh = scene.mesh(row)
            assert mesh.texture is not None
            assert mesh.uvs is not None
            assert max(mesh.texture.width, mesh.texture.height) <= 2048
            atlas = decoded(mesh.texture.data)
            uv = mesh.uvs[mesh.faces].mean(axis=1)
            places = mesh.positions[mesh.faces].mean(axis=1)
            east, north = places[:, 0] + 12.0, 12.0 - places[:, 2]
            is_east = east > SIDE / 2
            u = np.where(is_east, east / (SIDE / 2) - 1, east / (SIDE / 2))
            source = np.stack([u, 1.0 - north / SIDE], axis=1)
            want = np.where(
                is_east[:, None], at(paintings["east"], source), at(paintings["west"], source)
            )
            differences.append(np.abs(at(atlas.astype(float), uv) - want))
    mean = float(np.concatenate(differences).mean())
    assert mean < 4.0, mean


def decoded(data: bytes | memoryview) -> UInt8:
    return np.asarray(Image.open(io.BytesIO(bytes(data))).convert("RGB"))


def at(image: Float64, uv: Float64) -> Float64:
    height, width = image.shape[:2]
    column = np.clip((uv[:, 0] * width).astype(int), 0, width - 1)
    row = np.clip((uv[:, 1] * height).astype(int), 0, height - 1)
    return image[row, column]


def test_what_the_file_holds(built: tuple[Path, Path]) -> None:
    given = find_mesh([built[0]], SurveyStatement(crs="EPSG:32632"), MeshStatement())
    assert given is not None
    facts = inspect_mesh(given)
    assert facts["faces"] == 2 * SIDE * SIDE
    assert facts["open_edges"] == 4 * SIDE
    assert facts["pieces"] == 1
    assert [image["name"] for image in facts["textures"]["images"]] == ["west.png", "east.png"]
    assert facts["textures"]["faces_without"] == 0
    assert facts["place"]["shift"] == [500000, 5200000, 100]
    assert facts["place"]["shift_from"] == "model_offset.xyz"
    assert facts["refused"] is None


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ("no library", ReadError, "model.obj at line 1: its material library model.mtl"),
        ("no image", ReadError, "model.mtl at line 4: the texture east.png of material east"),
        ("bad image", ReadError, "its texture west.png cannot be read"),
        ("no face", ReadError, "no face"),
        ("repeats", ReadError, "faces repeat their image"),
        ("one place", SurveyError, "lie at one place"),
    ],
)
def test_what_cannot_be_built_leaves_nothing(
    tmp_path: Path, change: str, error: type[PipelineError], message: str
) -> None:
    model = write_model(tmp_path / "model")
    text = model.read_text()
    if change == "no library":
        model.with_suffix(".mtl").unlink()
    elif change == "no image":
        (model.parent / "east.png").unlink()
    elif change == "bad image":
        (model.parent / "west.png").write_bytes(b"no image")
    elif change == "no face":
        model.write_text("\n".join(line for line in text.split("\n") if line[:1] != "f"))
    elif change == "repeats":
        model.write_text(text.replace("vt 1.000000 1.000000", "vt 3.5 1.0"))
    elif change == "one place":
        model.write_text("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n")
    with pytest.raises(error, match=message):
        build(BuildOptions(model, tmp_path / "scene"))
    assert not (tmp_path / "scene" / "scene.json").exists()


def test_options_of_surveys_are_refused(tmp_path: Path) -> None:
    model = write_model(tmp_path / "model")
    with pytest.raises(OptionError, match="--max-points with a mesh"):
        build(BuildOptions(model, tmp_path / "scene", max_points=10_000))
    points = tmp_path / "points.xyz"
    points.write_text("".join(f"{i % 30} {i // 30} {i % 7}\n" for i in range(900)))
    own = Texturing(texture.Options(source="mesh"))
    with pytest.raises(OptionError, match="of a point cloud"):
        build(BuildOptions(points, tmp_path / "scene", texture=own))
    with pytest.raises(OptionError, match="photos for textures from the mesh"):
        Texturing(texture.Options(source="mesh"), photos=tmp_path)
