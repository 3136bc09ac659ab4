"""Picks against a brute-force ray over every triangle of the scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from server.grid_scene import GridScene, write_grid_scene

from terraport_payload import SegmentMesh
from terraport_server.errors import PickTimeoutError
from terraport_server.scenes.picking import MeshCache, pick, ray_box_entry, ray_triangles
from terraport_store import RegionNames, Scene
from terraport_wire import Hit


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> GridScene:
    return write_grid_scene(tmp_path_factory.mktemp("pick") / "grid", cells=6)


@pytest.fixture
def scene(grid: GridScene) -> Iterator[Scene]:
    with Scene.open(grid.path) as opened:
        yield opened


def ask(scene: Scene, origin: Any, direction: Any, **changed: Any) -> Hit | None:
    options: dict[str, Any] = {
        "names": RegionNames.of(scene.regions),
        "max_distance_m": 500.0,
        "max_segments": 100,
        "time_is_up": lambda: False,
        "failed": lambda _segment, _error: None,
    }
    cache = changed.pop("cache", MeshCache(1 << 24))
    return pick(scene, cache, origin, direction, **(options | changed))


def brute(meshes: list[SegmentMesh], origin: Any, direction: Any) -> float | None:
    """Nearest hit by a loop over triangles and a plain 3 x 3 solve."""
    best: float | None = None
    ray = np.asarray(direction, dtype=float)
    ray = ray / np.linalg.norm(ray)
    for mesh in meshes:
        corners = mesh.positions.astype(float)[mesh.faces]
        matrix = np.stack(
            [
                np.broadcast_to(-ray, (len(corners), 3)),
                corners[:, 1] - corners[:, 0],
                corners[:, 2] - corners[:, 0],
            ],
            axis=2,
        )
        solvable = np.abs(np.linalg.det(matrix)) > 1e-12
        t, u, v = np.linalg.solve(
            matrix[solvable], (np.asarray(origin) - corners[solvable, 0])[:, :, None]
        )[:, :, 0].T
        met = t[(t >= 0) & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)]
        if met.size and (best is None or met.min() < best):
            best = float(met.min())
    return best


def test_random_rays_equal_brute_force(scene: Scene, grid: GridScene) -> None:
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(150):
        origin = rng.uniform((-10, -3, -10), (70, 6, 70))
        direction = rng.normal(size=3)
        expected = brute(grid.meshes, origin, direction)
        hit = ask(scene, tuple(origin), tuple(direction))
        assert (hit is None) == (expected is None)
        if hit is None or expected is None:
            continue
        hits += 1
        distance = float(np.linalg.norm(np.asarray(hit.position) - origin))
        assert distance == pytest.approx(expected, abs=1e-9)
        corners = grid.meshes[hit.segment].positions
        assert (corners.min(axis=0) - 1e-6 <= hit.position).all()
        assert (hit.position <= corners.max(axis=0) + 1e-6).all()
    assert hits >= 30


def test_rays_through_shared_edges_and_vertices_do_not_slip_through(
    scene: Scene, grid: GridScene
) -> None:
    for mesh in grid.meshes[:6]:
        for x, _, z in mesh.positions[::5].tolist():
            assert ask(scene, (x, 9.0, z), (0.0, -1.0, 0.0)) is not None


def test_the_vertical_line_takes_the_nearest_and_the_lower_on_a_tie(scene: Scene) -> None:
    down = ask(scene, (15.0, 9.0, 25.0), None)
    up = ask(scene, (15.0, -9.0, 25.0), None)
    assert down is not None
    assert down == up
    level = down.position[1]
    assert ask(scene, (15.0, level, 25.0), None) == down


def test_the_ray_ends_at_the_largest_distance(scene: Scene) -> None:
    assert ask(scene, (15.0, 9.0, 25.0), (0, -1, 0), max_distance_m=7.0) is None
    assert ask(scene, (15.0, 9.0, 25.0), (0, -1, 0), max_distance_m=9.0) is not None


@pytest.mark.parametrize("scale", [1e-300, 1e-7, 1.0, 1e7])
def test_a_direction_of_any_length(scene: Scene, scale: float) -> None:
    hit = ask(scene, (15.0, 9.0, 25.0), (0.1 * scale, -scale, 0.2 * scale))
    assert hit == ask(scene, (15.0, 9.0, 25.0), (0.1, -1.0, 0.2))


def test_what_a_hit_says(scene: Scene) -> None:
    hit = ask(scene, (15.0, 9.0, 5.0), (0.0, -1.0, 0.0))
    assert hit is not None
    assert (hit.segment, hit.region, hit.stable_id, hit.label) == (1, 0, None, "road")
    assert np.linalg.norm(hit.normal) == pytest.approx(1.0)
    assert hit.normal[1] > 0.9
    assert hit.height_m == 100.0 + hit.position[1]
    assert hit.attributes["grade"] == pytest.approx(0.65, abs=2.0**-10)


def test_the_region_is_named_by_stable_id_and_users_label(scene: Scene) -> None:
    rows = [{"id": 0, "stable_id": 8, "label": "road"}, {"id": 1, "stable_id": 3}]
    document = {"regions": [*rows, {"id": 2, "stable_id": 5}], "next_stable_id": 9}
    names = RegionNames.of(document).with_labels({3: "bench", 8: "haul road"})
    named = [
        (hit.region, hit.stable_id, hit.label)
        for z in (5.0, 15.0, 25.0)
        if (hit := ask(scene, (15.0, 9.0, z), None, names=names)) is not None
    ]
    assert named == [(0, 8, "haul road"), (1, 3, "bench"), (2, 5, None)]


def test_both_sides_count_and_the_normal_is_the_front_side(scene: Scene) -> None:
    above = ask(scene, (15.0, 9.0, 5.0), (0.0, -1.0, 0.0))
    below = ask(scene, (15.0, -9.0, 5.0), (0.0, 1.0, 0.0))
    assert above is not None
    assert below is not None
    assert above.normal == below.normal


def test_attributes_without_a_value_are_left_out(scene: Scene, grid: GridScene) -> None:
    segment = grid.meshes[1]
    gap = SegmentMesh(
        positions=segment.positions,
        faces=segment.faces,
        normals=segment.normals,
        region_ids=segment.region_ids,
        attributes={"grade": np.full(len(segment.positions), np.nan, dtype=np.float32)},
    )

    class Gaps(MeshCache):
        def get(self, scene: Scene, segment: int) -> SegmentMesh:
            return gap

    hit = ask(scene, (15.0, 9.0, 5.0), (0.0, -1.0, 0.0), cache=Gaps(0))
    assert hit is not None
    assert hit.attributes == {}


def test_out_of_time_and_out_of_segments(scene: Scene) -> None:
    along = ((-5.0, 1.2, 5.0), (1.0, 0.0, 0.0))
    with pytest.raises(PickTimeoutError, match="after 0 segments"):
        ask(scene, *along, time_is_up=lambda: True)
    with pytest.raises(PickTimeoutError, match="after 2 segments"):
        ask(scene, *along, max_segments=2)


def test_the_cache_keeps_within_its_bytes_and_forgets_the_oldest(scene: Scene) -> None:
    unbounded = MeshCache(1 << 30)
    unbounded.get(scene, 0)
    size = unbounded.size_bytes
    cache = MeshCache(int(size * 2.5))
    first = cache.get(scene, 0)
    cache.get(scene, 1)
    assert cache.get(scene, 0) is first
    cache.get(scene, 2)
    assert cache.size_bytes <= size * 2.5
    assert cache.get(scene, 0) is first, "used last, kept"
    none = MeshCache(0)
    none.get(scene, 0)
    assert none.size_bytes == 0


def test_ray_box_entry() -> None:
    boxes = np.array([[1, -1, -1, 2, 1, 1], [-1, -1, -1, 1, 1, 1], [5, 2, 0, 6, 3, 1]], "f4")
    ray = np.array([1.0, 0.0, 0.0])
    entry = ray_box_entry(boxes, np.zeros(3), ray)
    assert entry.tolist() == [1.0, 0.0, np.inf]
    assert ray_box_entry(boxes, np.zeros(3), -ray).tolist() == [np.inf, 0.0, np.inf]


def test_degenerate_and_edge_on_faces_are_not_met() -> None:
    positions = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 1]], dtype=np.float32)
    faces = np.array([[0, 1, 2], [0, 1, 1], [0, 1, 3]], dtype=np.uint32)
    above, beside = np.array([0.5, 1.0, 0.25]), np.array([-1.0, 0.0, 0.25])
    assert ray_triangles(positions, faces, beside, np.array([1.0, 0.0, 0.0])) is None
    hit = ray_triangles(positions, faces, above, np.array([0.0, -1.0, 0.0]))
    assert hit is not None
    assert (hit.face, hit.distance_m) == (2, 1.0)
    assert hit.weights == pytest.approx((0.25, 0.5, 0.25))
