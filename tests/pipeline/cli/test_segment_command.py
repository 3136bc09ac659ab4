"""``terraport segment``: what it makes of bodies and of ground, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
import typer
from typer.testing import CliRunner, Result

from terraport_pipeline.cli.segment import register
from terraport_pipeline.engines.mesh_files.read_mesh import read_mesh
from terraport_pipeline.options.mesh_segments import MeshSegmentOptions
from terraport_pipeline.stages.mesh_segments import is_closed, segment_mesh


def run(*arguments: object) -> Result:
    app = typer.Typer(rich_markup_mode="markdown")
    app.callback()(lambda: None)
    register(app)
    words = ["segment", *map(str, arguments)]
    return CliRunner().invoke(app, words, env={"COLUMNS": "120"})


def dumb_bell() -> trimesh.Trimesh:
    """Two balls and a thin bar between them, as a surface of revolution."""
    n = 40
    z = np.linspace(-2, 2, n)
    ball = np.sqrt(np.maximum(0.6**2 - (np.abs(z) - 1.4) ** 2, 1e-4))
    radius = np.where(np.abs(z) < 0.85, 0.12, ball)
    around = np.arange(n) * 2 * np.pi / n
    vertices = np.stack(
        [np.outer(radius, np.cos(around)), np.outer(radius, np.sin(around)),
         np.repeat(z[:, None], n, 1)], axis=-1,
    ).reshape(-1, 3)  # fmt: skip
    i, j = np.meshgrid(np.arange(n - 1), np.arange(n), indexing="ij")
    a, b = i * n + j, i * n + (j + 1) % n
    faces = np.stack([a, b, b + n, a, b + n, a + n], axis=-1).reshape(-1, 3)
    poles = np.array([[0, 0, -2.01], [0, 0, 2.01]])
    ring = np.arange(n)
    after, last = (ring + 1) % n, n * (n - 1)
    caps = [
        np.stack([np.full(n, n * n), after, ring], 1),
        np.stack([np.full(n, n * n + 1), last + ring, last + after], 1),
    ]
    return trimesh.Trimesh(
        np.concatenate([vertices, poles]), np.concatenate([faces, *caps]), process=False
    )


@pytest.fixture(scope="module")
def body(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bodies") / "bell.off"
    dumb_bell().export(path)
    return path


def parts_of(labels: np.ndarray, mesh: Path) -> list[int]:
    """The labels of both balls and of the bar's middle."""
    read = read_mesh(mesh)
    height = read.vertices[read.faces].mean(axis=1)[:, 2]
    return [int(np.median(labels[np.abs(height - at) < 0.2])) for at in (-1.5, 0.0, 1.5)]


def test_a_body_without_colour_falls_into_its_parts(body: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.seg"
    result = run(body, "-o", out, "--k", 3)
    assert result.exit_code == 0, result.output
    labels = np.loadtxt(out, dtype=int)
    assert len(labels) == len(read_mesh(body).faces)
    assert len(set(parts_of(labels, body))) == 3
    assert "shape, engine graph" in result.output
    assert "closed, 1 separate piece" in result.output


def test_a_mesh_that_stays_in_one_segment_is_a_warning(tmp_path: Path) -> None:
    ball = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=3).export(ball)
    result = run(ball, "-o", tmp_path / "a.seg")
    assert result.exit_code == 0, result.output
    words = "warning: the mesh came out as one segment: engine graph finds no border by shape"
    assert words in " ".join(result.output.split())
    result = run(ball, "-o", tmp_path / "b.seg", "--k", 1)
    assert "warning" not in result.output


def test_k_is_how_many(body: Path, tmp_path: Path) -> None:
    for k in (1, 2, 5):
        assert run(body, "-o", tmp_path / "a.npy", "--k", k, "--force").exit_code == 0
        assert len(np.unique(np.load(tmp_path / "a.npy"))) == k


def test_thickness_with_the_triangle_pools(body: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.npy"
    assert run(body, "-o", out, "--engine", "tpa", "--by", "shape").exit_code == 0
    left, bar, right = parts_of(np.load(out), body)
    assert left != bar != right


@pytest.mark.parametrize("engine", ["means", "graph", "tpa", "felzenszwalb"])
def test_every_engine_by_colour_and_by_attribute(tmp_path: Path, engine: str) -> None:
    ground = trimesh.creation.box((4, 4, 1)).subdivide().subdivide().subdivide()
    left = ground.vertices[:, 0] < 0
    ground.visual.vertex_colors = np.where(left[:, None], [200, 40, 40], [40, 60, 200]).astype(
        np.uint8
    )
    ground.vertex_attributes["grade"] = left * 5.0
    ground.export(tmp_path / "a.ply")
    for by in ("colour", "grade"):
        result = run(
            tmp_path / "a.ply", "-o", tmp_path / "a.npy", "--engine", engine, "--by", by, "--force"
        )
        assert result.exit_code == 0, result.output
        labels = np.load(tmp_path / "a.npy")
        middle = ground.vertices[ground.faces].mean(axis=1)[:, 0]
        sides = [np.unique(labels[middle < -0.6]), np.unique(labels[middle > 0.6])]
        assert not set(sides[0]) & set(sides[1]), (engine, by)


def test_numbers_from_a_file(body: Path, tmp_path: Path) -> None:
    mesh = read_mesh(body)
    upper = mesh.vertices[mesh.faces].mean(axis=1)[:, 2] > 0
    (tmp_path / "of_faces.txt").write_text("\n".join(str(float(value)) for value in upper))
    np.save(tmp_path / "of_vertices.npy", (mesh.vertices[:, 2] > 0) * 1.0)
    for name in ("of_faces.txt", "of_vertices.npy"):
        out = tmp_path / "a.npy"
        result = run(body, "-o", out, "--by", tmp_path / name, "--engine", "tpa", "--force")
        assert result.exit_code == 0, result.output
        left, _, right = parts_of(np.load(out), body)
        assert left != right
        assert name in result.output


def test_the_grid_looks_from_above(tmp_path: Path) -> None:
    wall = trimesh.creation.box((4, 0.1, 8)).subdivide().subdivide()
    wall.export(tmp_path / "a.ply")
    for name in ("a.ply", "a.glb"):
        wall.export(tmp_path / name)
        out = tmp_path / "a.npy"
        result = run(tmp_path / name, "-o", out, "--engine", "grid", "--by", "shape",
                     "--grid-cell-m", 1.5, "--force")  # fmt: skip
        assert result.exit_code == 0, result.output
        height = wall.vertices[wall.faces].mean(axis=1)[:, 2]
        labels = np.load(out)
        together = bool(set(labels[height < -3]) & set(labels[height > 3]))
        assert together == (name == "a.ply")  # z is up in a PLY, y in a GLB


def test_options_of_researchers_change_the_result(body: Path) -> None:
    mesh = read_mesh(body)
    by_shape = {"by": "shape", "engine": "tpa"}
    usual = segment_mesh(mesh, MeshSegmentOptions(**by_shape))
    finer = segment_mesh(mesh, MeshSegmentOptions(**by_shape, tpa_range=8.0, tpa_islands="stay"))
    assert finer.count > usual.count
    one = segment_mesh(mesh, MeshSegmentOptions(graph_concavity=0.0, graph_cut_drop=0.1))
    assert one.count < segment_mesh(mesh, MeshSegmentOptions(graph_cut_drop=30.0)).count


def test_closed_and_open() -> None:
    ball = trimesh.creation.icosphere(2)
    assert is_closed(ball.vertices, ball.faces)
    assert not is_closed(ball.vertices, ball.faces[ball.triangles_center[:, 2] > 0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "a.txt"], "expected .seg, .npy, .ply or .glb"),
        (["-o", "a.seg", "--by", "colour"], "the mesh has none; expected --by shape"),
        (["-o", "a.seg", "--by", "ore"], "this mesh has colour, shape, and no file"),
        (["-o", "a.seg", "--by", "WORDS"], "does not hold numbers alone"),
        (["-o", "a.seg", "--by", "SHORT"], "3 values; expected one for each of"),
        (["-o", "a.seg", "--by", "NAN"], "1 of 3200 values are not finite"),
        (["-o", "a.seg", "--engine", "tpa", "--k", "3"], "expected --engine graph"),
        (["-o", "a.seg", "--tpa-range", "3"], "expected engine tpa"),
        (["-o", "a.seg", "--graph-cut-drop", "0"], "above 0"),
        (["-o", "THERE"], "--force"),
    ],
)
def test_what_is_refused(body: Path, tmp_path: Path, arguments: list[str], message: str) -> None:
    faces = len(read_mesh(body).faces)
    (tmp_path / "words.txt").write_text("a b")
    (tmp_path / "short.txt").write_text("1 2 3")
    (tmp_path / "nan.txt").write_text("nan " + "1 " * (faces - 1))
    (tmp_path / "there.seg").write_text("0")
    at = {"WORDS": "words.txt", "SHORT": "short.txt", "NAN": "nan.txt", "THERE": "there.seg"}
    words = [str(tmp_path / at[word]) if word in at else word for word in arguments]
    words = [str(tmp_path / word) if word.startswith("a.") else word for word in words]
    result = run(body, *words)
    assert result.exit_code in (1, 2)
    assert message in " ".join(result.output.split())
    assert not (tmp_path / "a.seg").exists()


def test_the_help_says_what_to_type() -> None:
    shown = " ".join(run("--help").output.split())
    for words in (
        "terraport segment hand.off -o hand.seg --k 6",
        "--by",
        "--tpa-contiguity",
        ".glb",
    ):
        assert words in shown
