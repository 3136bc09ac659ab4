from __future__ import annotations

from dataclasses import replace
from typing import Any

import meshopt
import numpy as np
import pytest
from glb_file import read_glb, split_glb
from hypothesis import given, settings
from hypothesis import strategies as st
from store.tiny_scene import CELLS, SCALES, STEP_M, lattice_mesh

from terraport_payload import (
    AttributeScale,
    PayloadError,
    SegmentMesh,
    encode_glb,
    gltf_attribute_name,
    snap,
)
from terraport_payload.order import cache_order


def encode(mesh: SegmentMesh, **options: Any) -> bytes:
    options = {"step_m": STEP_M, "attribute_scales": SCALES, **options}
    return encode_glb(mesh, **options)


def corners(mesh: SegmentMesh) -> list[tuple[bytes, bytes, bytes]]:
    """Faces as positions, rotated so that the smallest comes first: the same for any vertex
    order."""
    rows = []
    for face in mesh.faces:
        keys = [mesh.positions[vertex].tobytes() for vertex in face]
        first = keys.index(min(keys))
        rows.append((keys[first], keys[(first + 1) % 3], keys[(first + 2) % 3]))
    return rows


def by_position(mesh: SegmentMesh, values: np.ndarray) -> dict[bytes, list[float]]:
    """Per-vertex values by position: comparable whatever the vertex order."""
    return {
        position.tobytes(): np.atleast_1d(value).tolist()
        for position, value in zip(mesh.positions, values, strict=True)
    }


@pytest.mark.parametrize("options", [{}, {"unlit": True}])
def test_same_mesh_comes_back(patch: SegmentMesh, options: dict[str, bool]) -> None:
    back = read_glb(encode(patch, **options))
    snapped = replace(patch, positions=snap(patch.positions, STEP_M))
    assert np.abs(back.positions.max(axis=0) - patch.positions.max(axis=0)).max() <= STEP_M / 2
    assert sorted(corners(back)) == sorted(corners(snapped))
    assert by_position(back, back.colours) == by_position(snapped, patch.colours)
    assert by_position(back, back.region_ids) == by_position(snapped, patch.region_ids)


@given(st.integers(0, 2**32 - 1), st.integers(-12, -4))
@settings(max_examples=40)
def test_errors_are_within_their_bounds(seed: int, exponent: int) -> None:
    """Position and attribute within half a step, normals within 2 degrees, colours exact."""
    rng = np.random.default_rng(seed)
    count, step = 50, 2.0**exponent
    centre = rng.uniform(-2000, 2000, 3)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    mesh = SegmentMesh(
        positions=(centre + rng.uniform(-7, 7, (count, 3))).astype(np.float32),
        faces=np.arange(count - count % 3, dtype=np.uint32).reshape(-1, 3),
        normals=normals.astype(np.float32),
        colours=rng.integers(0, 256, (count, 3)).astype(np.uint8),
        attributes={"a": rng.uniform(-3, 5, count).astype(np.float32)},
    )
    scale = AttributeScale(-3.0, 8.001 / 65534)
    back = read_glb(encode(mesh, step_m=step, attribute_scales={"a": scale}))
    _, order = cache_order(mesh)
    normals = normals[order]
    mesh = replace(
        mesh,
        positions=mesh.positions[order],
        colours=mesh.colours[order],
        attributes={"a": mesh.attributes["a"][order]},
    )
    assert np.abs(back.positions.astype(float) - mesh.positions).max() <= step / 2
    assert np.array_equal(back.positions, snap(mesh.positions, step))
    assert np.array_equal(back.colours, mesh.colours)
    assert (
        np.abs(back.attributes["a"].astype(float) - mesh.attributes["a"]).max()
        <= scale.step / 2 + 5e-7
    )
    cosine = (back.normals.astype(float) * normals).sum(axis=1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 2.0
    assert np.allclose(np.linalg.norm(back.normals, axis=1), 1.0, atol=1e-6)


def test_border_vertices_of_neighbours_are_bit_equal() -> None:
    """Positions on the common border decode to the same bits in both segments, wherever their boxes
    start."""
    left, right = lattice_mesh(0, 0), lattice_mesh(CELLS, 0)
    back_left, back_right = read_glb(encode(left)), read_glb(encode(right))
    border_x = np.float32(CELLS * 0.25)
    rows = {p.tobytes() for p in back_left.positions if p[0] == border_x}
    assert rows == {p.tobytes() for p in back_right.positions if p[0] == border_x}
    assert len(rows) == CELLS + 1


def test_float32_arithmetic_of_a_shader_gives_the_same_bits(patch: SegmentMesh) -> None:
    """translation + scale * code, all in float32, is the position on the grid."""
    document, binary = split_glb(encode(patch))
    node = document["nodes"][0]
    packed = document["bufferViews"][0]["extensions"]["EXT_meshopt_compression"]
    rows = meshopt.decode_gltf_buffer(
        binary[: packed["byteLength"]],
        packed["count"],
        packed["byteStride"],
        packed["mode"],
        "NONE",
    )
    codes = rows.view("<u2").reshape(-1, 4)[:, :3]
    shader = np.array(node["translation"], dtype=np.float32) + np.array(
        node["scale"], dtype=np.float32
    ) * codes.astype(np.float32)
    assert shader.dtype == np.float32
    expected = snap(patch.positions, STEP_M)
    assert sorted(map(bytes, shader)) == sorted(map(bytes, expected))


def test_wide_mesh_keeps_float_positions_on_the_grid(patch: SegmentMesh) -> None:
    """A base mesh 1.5 km wide at the finest step."""
    wide = replace(patch, positions=patch.positions * np.float32(1000))
    data = encode(wide)
    assert split_glb(data)[0]["accessors"][0]["componentType"] == 5126
    back = read_glb(data)
    assert sorted(map(bytes, back.positions)) == sorted(map(bytes, snap(wide.positions, STEP_M)))


def test_same_input_same_bytes(patch: SegmentMesh) -> None:
    assert encode(patch) == encode(patch)


def test_inputs_are_not_modified(patch: SegmentMesh) -> None:
    arrays = [patch.positions, patch.faces, patch.normals, patch.colours, patch.region_ids]
    for values in [*arrays, patch.attributes["grade"]]:
        values.flags.writeable = False
    encode(patch)


def test_more_than_65535_vertices_take_wide_indices() -> None:
    def indices(cells: int) -> int:
        mesh = lattice_mesh(0, 0, cells)
        small = replace(mesh, colours=None, region_ids=None, attributes={})
        data = encode(small, step_m=2.0**-9)
        assert len(read_glb(data).faces) == 2 * cells * cells
        return split_glb(data)[0]["accessors"][-1]["componentType"]

    assert indices(254) == 5123  # 65025 vertices
    assert indices(255) == 5125  # 65536 vertices


def test_zero_normals_become_up(triangle: SegmentMesh) -> None:
    mesh = replace(triangle, normals=np.zeros((3, 3), dtype=np.float32))
    assert read_glb(encode(mesh)).normals.tolist() == [[0, 1, 0]] * 3


def test_unused_vertices_survive(triangle: SegmentMesh) -> None:
    mesh = SegmentMesh(
        positions=np.vstack([triangle.positions, np.array([[5, 5, 5]], dtype=np.float32)]),
        faces=triangle.faces,
        normals=np.vstack([triangle.normals, np.array([[0, 1, 0]], dtype=np.float32)]),
    )
    assert len(read_glb(encode(mesh)).positions) == 4


def test_document_says_what_the_format_promises(patch: SegmentMesh) -> None:
    document = split_glb(encode(patch))[0]
    assert document["extensionsRequired"] == ["KHR_mesh_quantization", "EXT_meshopt_compression"]
    mesh = document["meshes"][0]
    assert mesh["primitives"][0]["extensions"]["EXT_mesh_features"]["featureIds"] == [
        {"featureCount": 1, "attribute": 0, "label": "region"}
    ]
    assert mesh["extras"]["terraport"] == {
        "step_m": STEP_M,
        "attributes": [
            {
                "name": "grade",
                "gltf_name": "_GRADE",
                "offset": 0.0,
                "step": SCALES["grade"].step,
                "null": 65535,
            }
        ],
    }
    assert document["buffers"][1]["extensions"] == {"EXT_meshopt_compression": {"fallback": True}}
    assert document["materials"] == [
        {"pbrMetallicRoughness": {"metallicFactor": 0}, "doubleSided": True}
    ]
    unlit = split_glb(encode(patch, unlit=True))[0]
    assert unlit["materials"][0]["extensions"] == {"KHR_materials_unlit": {}}
    assert "KHR_materials_unlit" in unlit["extensionsUsed"]
    assert "KHR_mesh_quantization" in document["extensionsUsed"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [("grade", "_GRADE"), ("Ore grade (%)", "_ORE_GRADE____"), ("Höhe", "_H_HE"), ("a_1", "_A_1")],
)
def test_gltf_names(name: str, expected: str) -> None:
    assert gltf_attribute_name(name) == expected


@pytest.mark.parametrize(
    ("names", "scales", "message"),
    [
        (["x"], {}, r"no scale for attribute 'x', expected one of \[\]"),
        (["a b", "a_b"], {"a b", "a_b"}, "'a_b' becomes '_A_B', which is taken"),
        (["feature_id_0"], {"feature_id_0"}, "becomes '_FEATURE_ID_0', which is taken"),
    ],
)
def test_refuses_attributes(
    triangle: SegmentMesh, names: list[str], scales: set[str], message: str
) -> None:
    mesh = replace(triangle, attributes={name: np.zeros(3, dtype=np.float32) for name in names})
    with pytest.raises(PayloadError, match=message):
        encode(mesh, attribute_scales={name: AttributeScale(0, 1) for name in scales})


def test_refuses_a_step_that_is_no_power_of_two(triangle: SegmentMesh) -> None:
    with pytest.raises(PayloadError, match=r"step_m is 0\.001"):
        encode(triangle, step_m=0.001)
