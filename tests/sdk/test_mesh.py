"""Meshes for their users."""

from __future__ import annotations

import builtins
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from glb_file import read_glb
from payload.images import png
from store.tiny_scene import CELLS, SCALES, STEP_M, lattice_mesh

from terraport.base import BaseMesh
from terraport.cache import CachedSegment
from terraport.errors import MissingExtraError, ProtocolViolationError, UsageError
from terraport.landing import Segment
from terraport.mesh import concatenate, mixed_model, to_trimesh, write_glb
from terraport_payload import SegmentMesh, Texture, encode_segment


@pytest.fixture
def base() -> BaseMesh:
    return BaseMesh("v", lattice_mesh(0, 0, 4, stride=3))


def hidden(base: BaseMesh, *shown: int) -> np.ndarray:
    """Base faces whose middle lies in a quarter that is shown."""
    middle = base.mesh.positions[base.mesh.faces].mean(axis=1)
    over = (middle[:, 0] > 1.5).astype(int) * 2 + (middle[:, 2] < -1.5)
    return np.isin(over, shown)


def tile(number: int) -> SegmentMesh:
    return lattice_mesh(number // 2 * CELLS, number % 2 * CELLS)


def test_what_is_printed_is_short_and_says_what_there_is(base: BaseMesh) -> None:
    image = Texture.of(png(128, 64))
    textured = dataclasses.replace(tile(0), colours=None, attributes={}, texture=image)
    assert repr(base.mesh) == (
        "<SegmentMesh 32 faces, 25 vertices, 3 x 0.7075 x 3 m, colours, region_ids, grade>"
    )
    assert repr(image) == f"<Texture image/png, 128 x 64 pixels, {len(image.data):,} bytes>"
    assert repr(textured).endswith(f"region_ids, {image!r}>")
    assert repr(concatenate([])) == "<SegmentMesh 0 faces, 0 vertices>"
    assert repr(base) == f"<BaseMesh of version v: {base.mesh!r}>"
    entry = CachedSegment(7, (0, 0, 0, 1, 1, 1), bytes(2048))
    segment = Segment(12, 32, 25, entry, "stream", {})
    assert repr(segment) == "<Segment 12: 32 faces, 25 vertices, 2,048 bytes, from stream>"


def test_to_trimesh_keeps_every_vertex_and_face() -> None:
    mesh = tile(0)
    converted = to_trimesh(mesh)
    np.testing.assert_array_equal(converted.vertices, mesh.positions)
    np.testing.assert_array_equal(converted.faces, mesh.faces)
    np.testing.assert_array_equal(converted.visual.vertex_colors[:, :3], mesh.colours)
    np.testing.assert_array_equal(converted.vertex_attributes["grade"], mesh.attributes["grade"])
    np.testing.assert_array_equal(converted.vertex_attributes["region_id"], mesh.region_ids)


def test_without_trimesh_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *arguments, **options):
        if name == "trimesh":
            raise ImportError(name)
        return real(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match='pip install "trimesh"'):
        to_trimesh(tile(0))


@pytest.mark.parametrize("shown", [(), (0,), (1, 2), (0, 1, 2, 3)])
def test_the_mixed_model_has_the_right_faces(base: BaseMesh, shown: tuple[int, ...]) -> None:
    """8 base faces a quarter: those of shown quarters are replaced by the segment's 72."""
    model = mixed_model(base, {number: tile(number) for number in shown}, hidden(base, *shown))
    assert len(model.faces) == 8 * (4 - len(shown)) + 72 * len(shown)
    assert model.faces.max() < len(model.positions)
    # The model covers the patch, seen from above, exactly once: 3 m x 3 m.
    flat = model.positions * np.array([1, 0, 1])
    a, b, c = (flat[model.faces[:, corner]] for corner in range(3))
    area = np.abs(np.cross(b - a, c - a)).sum() / 2
    assert area == pytest.approx(9.0, rel=1e-5)


def test_the_rim_is_sunk_and_nothing_else() -> None:
    """One quad under two segments, one loaded: its vertices move down by as much as was asked."""
    corners = np.float32([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]])
    up = np.tile(np.float32([0, 1, 0]), (4, 1))
    mesh = SegmentMesh(corners, np.uint32([[0, 1, 2], [0, 2, 3]]), up)
    base, drawn = BaseMesh("v", mesh), np.zeros(2, bool)
    # The detail lies 0.1 m below the base: the rim sinks half as far again, and at most as asked.
    detail = dataclasses.replace(mesh, positions=mesh.positions - 0.1 * mesh.normals)
    for most_m, depth_m in ((0.5, 0.15), (0.12, 0.12)):
        sunk = mixed_model(base, {0: detail}, drawn, sink_rim_m=most_m)
        moved = np.linalg.norm(mesh.positions - sunk.positions[: len(mesh.positions)], axis=1)
        assert depth_m * 0.9 < moved.max() <= depth_m * 1.0001
        np.testing.assert_array_equal(sunk.positions[len(mesh.positions) :], detail.positions)
    above = dataclasses.replace(mesh, positions=mesh.positions + 0.1 * mesh.normals)
    kept = mixed_model(base, {0: above}, drawn, sink_rim_m=0.5)
    np.testing.assert_array_equal(kept.positions[: len(mesh.positions)], mesh.positions)
    np.testing.assert_array_equal(base.mesh.positions, mesh.positions)
    with pytest.raises(UsageError, match="sink_rim_m is -1"):
        mixed_model(base, {}, drawn, sink_rim_m=-1)


def test_the_base_is_pushed_back_along_the_lines_of_sight(base: BaseMesh) -> None:
    """Every vertex stays on its pixel, farther by as much as was asked; detail stays."""
    eye = np.array([1.0, 9.0, 2.0])
    model = mixed_model(base, {0: tile(0)}, hidden(base, 0), push_back_m=0.5, eye=eye)
    plain = mixed_model(base, {0: tile(0)}, hidden(base, 0))
    count = len(plain.positions) - len(tile(0).positions)
    before, after = plain.positions[:count] - eye, model.positions[:count] - eye
    near, far = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
    np.testing.assert_allclose(far - near, 0.5, atol=1e-5)
    np.testing.assert_allclose(before / near[:, None], after / far[:, None], atol=1e-6)
    np.testing.assert_array_equal(model.positions[count:], tile(0).positions)
    with pytest.raises(UsageError, match="push_back_m is 1 without eye"):
        mixed_model(base, {}, hidden(base), push_back_m=1)


def test_concatenate_fills_what_some_do_not_have() -> None:
    bare = SegmentMesh(tile(0).positions, tile(0).faces, tile(0).normals)
    both = concatenate([bare, tile(1)])
    count = len(bare.positions)
    assert (both.colours[:count] == 160).all()
    assert np.isnan(both.attributes["grade"][:count]).all()
    assert (both.region_ids[:count] == 0).all()
    np.testing.assert_array_equal(both.faces[len(bare.faces) :], tile(1).faces + count)
    assert concatenate([bare, bare]).colours is None
    assert len(concatenate([]).faces) == 0


def test_a_written_glb_comes_back_on_the_grid(tmp_path: Path, base: BaseMesh) -> None:
    model = mixed_model(base, {0: tile(0)}, hidden(base, 0), sink_rim_m=0.01)
    path = tmp_path / "here.glb"
    size = write_glb(model, path, step_m=STEP_M, attribute_scales=SCALES)
    assert size == path.stat().st_size
    read = read_glb(path.read_bytes())
    assert len(read.faces) == len(model.faces)
    read_back, written = np.sort(read.positions, axis=0), np.sort(model.positions, axis=0)
    np.testing.assert_allclose(read_back, written, rtol=0, atol=STEP_M)
    assert [path.name for path in tmp_path.iterdir()] == ["here.glb"]


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, base: BaseMesh) -> None:
    path = tmp_path / "here.glb"
    path.write_bytes(b"old")
    with pytest.raises(ValueError, match="expected at least one face"):
        write_glb(concatenate([]), path, step_m=STEP_M)
    assert path.read_bytes() == b"old"
    with pytest.raises(FileNotFoundError):
        write_glb(base.mesh, tmp_path / "nowhere" / "here.glb", step_m=STEP_M)


def test_a_base_mesh_that_cannot_be_decoded_is_a_violation() -> None:
    data = encode_segment(tile(0), step_m=STEP_M, scales=SCALES)
    assert len(BaseMesh.of("v", data, SCALES).mesh.faces) == len(tile(0).faces)
    with pytest.raises(ProtocolViolationError, match="base mesh: "):
        BaseMesh.of("v", data[:-8], SCALES)
