"""Greedy projection: closed where samples are even, sheets kept apart, and PCL's beside it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.mesh.mesh_edges import edge_facts
from terraport_research.kernels.greedy_projection import project_greedily

PCL = "pcl_gp3_surface"


def spiral_ball(count: int = 2000) -> tuple[Float32, float]:
    place = np.arange(count) + 0.5
    z, turn = 1 - 2 * place / count, place * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - z * z)
    points = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    return points.astype(np.float32), float(np.sqrt(4 * np.pi / count))


def random_torus(count: int = 3000) -> tuple[Float32, Float32, float]:
    rng = np.random.default_rng(0)
    u, v = rng.random((2, count)) * 2 * np.pi
    normals = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], axis=1)
    points = np.stack([np.cos(u), np.sin(u), 0 * u], axis=1) * 3 + normals
    spacing = float(np.sqrt(12 * np.pi**2 / count))
    noisy = points + rng.normal(0, spacing / 20, points.shape)
    return noisy.astype(np.float32), normals.astype(np.float32), spacing


def test_even_samples_close_a_ball() -> None:
    points, spacing = spiral_ball()
    faces = project_greedily(points, points, 4 * spacing, 3.0)
    facts = edge_facts(faces)
    assert (len(facts.open_edges), facts.non_manifold, facts.against) == (0, 0, 0)
    assert facts.euler == 2
    assert len(faces) == 2 * len(points) - 4  # every sample is a vertex
    a, b, c = (points[faces[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) > 0).all()
    np.testing.assert_array_equal(project_greedily(points, points, 4 * spacing, 3.0), faces)


def test_two_sides_of_a_thin_wall_stay_two() -> None:
    x, y = np.meshgrid(np.arange(12.0), np.arange(12.0))
    sheet = np.stack([x.ravel(), y.ravel() + 0.3 * (x.ravel() % 2), 0 * x.ravel()], axis=1)
    points = np.concatenate([sheet, sheet - [0, 0, 0.4]]).astype(np.float32)
    up = np.tile([0, 0, 1.0], (len(sheet), 1))
    normals = np.concatenate([up, -up]).astype(np.float32)
    faces = project_greedily(points, normals, 4.0, 3.0)
    side = faces >= len(sheet)
    assert (side.all(axis=1) | ~side.any(axis=1)).all()
    a, b, c = (points[faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    # No face lies over another: the sheets' areas are those of their outlines, at most.
    assert np.abs(area[:, 2]).sum() / 2 <= 2 * 11 * 11.3
    assert np.abs(area[:, 2]).sum() / 2 > 2 * 11 * 10.7
    facts = edge_facts(faces)
    assert (facts.non_manifold, facts.against) == (0, 0)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_few_samples(count: int) -> None:
    points = np.eye(3, dtype=np.float32)[:count]
    normals = np.full((count, 3), 3**-0.5, np.float32)
    assert len(project_greedily(points, normals, 2.0, 3.0)) == (count == 3)
    same = np.zeros((5, 3), np.float32)
    assert len(project_greedily(same, np.full((5, 3), 3**-0.5, np.float32), 2.0, 3.0)) == 0


def test_a_radius_of_nothing_is_refused() -> None:
    points, _ = spiral_ball(10)
    with pytest.raises(ValueError, match="radius of 0"):
        project_greedily(points, points, 0.0, 3.0)


def pcl_faces(points: Float32, normals: Float32, radius: float, folder: Path) -> Int32:
    rows = np.zeros((len(points), 7), "<f4")
    rows[:, :3], rows[:, 3:6] = points, normals
    header = (
        "VERSION 0.7\nFIELDS x y z normal_x normal_y normal_z curvature\nSIZE 4 4 4 4 4 4 4\n"
        f"TYPE F F F F F F F\nCOUNT 1 1 1 1 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\n"
        f"POINTS {len(points)}\nDATA binary\n"
    )
    (folder / "in.pcd").write_bytes(header.encode("ascii") + rows.tobytes())
    asked = [PCL, str(folder / "in.pcd"), str(folder / "out.vtk"), "-radius", str(radius)]
    subprocess.run([*asked, "-mu", "3"], check=True, capture_output=True, timeout=60)
    rest = (folder / "out.vtk").read_text("ascii").partition("\nPOLYGONS ")[2].partition("\n")[2]
    numbers = np.fromstring(rest, dtype=np.int64, sep=" ")
    return numbers.reshape(-1, 4)[:, 1:].astype(np.int32)


@pytest.mark.skipif(shutil.which(PCL) is None, reason="pcl-tools is not installed")
def test_beside_pcl_fewer_holes_and_no_farther_from_the_truth(tmp_path: Path) -> None:
    points, normals, spacing = random_torus()
    ours = project_greedily(points, normals, 4 * spacing, 3.0)
    theirs = pcl_faces(points, normals, 4 * spacing, tmp_path)
    assert edge_facts(ours).non_manifold == 0
    open_edges = [len(edge_facts(faces).open_edges) for faces in (ours, theirs)]
    assert open_edges[0] <= open_edges[1]
    assert 0.98 < len(ours) / len(theirs) < 1.15
    # On random samples the two pick other diagonals; how far faces lie from the truth is alike.
    far = []
    for faces in (ours, theirs):
        middle = points[faces].mean(axis=1)
        ring = np.hypot(middle[:, 0], middle[:, 1]) - 3
        far.append(float(np.quantile(np.abs(np.hypot(ring, middle[:, 2]) - 1), 0.95)))
    assert far[0] <= 1.05 * far[1]
