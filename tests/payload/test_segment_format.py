"""Segment format 2: what is encoded comes back, by our reader and by the specification's."""

from __future__ import annotations

import gzip
import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from payload.images import pillow

from terraport_payload import AttributeScale, PayloadError, SegmentMesh, Texture, snap, snap_uvs
from terraport_payload.segment_format import (
    MAX_ATTRIBUTES,
    MAX_STREAM_BYTES,
    decode_segment,
    encode_segment,
    segment_bounds,
    segment_texture,
)

ROOT = Path(__file__).parents[2]
GOLDEN = Path(__file__).with_name("golden_segments")
STEP_M = 2.0**-8
SCALES = {"grade": AttributeScale(0.0, 1 / 65534), "moisture": AttributeScale(-5.0, 0.25)}


@pytest.fixture(scope="module")
def read_segment() -> Callable[[bytes], Any]:
    """The reader in the specification's text."""
    text = (ROOT / "spec/segment-format.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert code is not None
    assert len(code[1].splitlines()) <= 60
    names: dict[str, Any] = {}
    exec(code[1], names)
    read: Callable[[bytes], Any] = names["read_segment"]
    return read


def random_mesh(seed: int, faces: int, *, manifold: bool, kind: str) -> SegmentMesh:
    """Triangles of a lattice or any triangles at all, with colours or an image, and attributes.

    What is wide is 300 m wide, or more: beyond 65,535 steps.
    """
    random = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(faces / 2))) + 1
    place = np.arange(side * side).reshape(side, side)
    a, b, c, d = (place[i : side - 1 + i, j : side - 1 + j].ravel() for i in (0, 1) for j in (0, 1))
    corners = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])
    corners = corners[random.permutation(len(corners))] if seed % 2 else corners
    if not manifold:
        corners = random.integers(0, side * side, (faces, 3))
    used, corners = np.unique(corners[:faces], return_inverse=True)
    count = len(used)
    normals = random.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    positions = np.stack(
        [used % side * 0.3, random.normal(size=count), used // side * -0.3], axis=1
    )
    mesh = SegmentMesh(
        positions=snap(positions.astype(np.float32), STEP_M),
        faces=corners.reshape(-1, 3).astype(np.uint32),
        normals=normals.astype(np.float32),
        region_ids=(np.full(count, 7) if seed % 3 else np.arange(count) // 5).astype(np.uint16),
        attributes={"moisture": np.where(used % 4, used * 0.25 - 5, np.nan).astype(np.float32)},
    )
    if kind == "wide":
        mesh = replace(mesh, positions=mesh.positions * np.float32(1 << 10))
    if kind in ("colours", "wide"):
        return replace(mesh, colours=random.integers(0, 256, (count, 3), dtype=np.uint8))
    if kind == "image":
        uvs = snap_uvs(random.random((count, 2)).astype(np.float32), 16, 8)
        return replace(mesh, uvs=uvs, texture=Texture.of(pillow("JPEG")))
    return replace(mesh, region_ids=None, attributes={})


def corner_rows(mesh: SegmentMesh) -> np.ndarray[Any, Any]:
    """What each face's corners have, each face turned so that its rows are in a fixed order."""
    corners = [mesh.positions[mesh.faces]]
    for values in (mesh.colours, mesh.uvs):
        if values is not None:
            corners.append(values[mesh.faces].astype(np.float32))
    if mesh.region_ids is not None:
        corners.append(mesh.region_ids[mesh.faces][..., None].astype(np.float32))
    for name in sorted(mesh.attributes):
        corners.append(np.nan_to_num(mesh.attributes[name][mesh.faces], nan=-1e9)[..., None])
    rows = np.concatenate(corners, axis=2)
    turned = [
        min((np.roll(face, -k, axis=0) for k in range(3)), key=lambda r: r.tolist())
        for face in rows
    ]
    return np.array(turned)


def angles_deg(before: SegmentMesh, after: SegmentMesh) -> np.ndarray[Any, Any]:
    """Between normals of corresponding vertices; vertices are numbered by first use in strips."""
    order = {
        tuple(row): n for row, n in zip(before.positions.tolist(), before.normals, strict=True)
    }
    wanted = np.array([order[tuple(row)] for row in after.positions.tolist()])
    return np.degrees(np.arccos(np.clip((wanted * after.normals).sum(axis=1), -1, 1)))


@given(
    seed=st.integers(0, 1 << 30),
    faces=st.integers(1, 60),
    manifold=st.booleans(),
    kind=st.sampled_from(["plain", "colours", "image", "wide"]),
)
def test_what_is_encoded_comes_back(seed: int, faces: int, manifold: bool, kind: str) -> None:
    mesh = random_mesh(seed, faces, manifold=manifold, kind=kind)
    data = encode_segment(mesh, step_m=STEP_M, scales=SCALES, may_be_wide=kind == "wide")
    decoded = decode_segment(data, scales=SCALES)
    assert np.array_equal(corner_rows(decoded), corner_rows(mesh))
    assert decoded.texture == mesh.texture
    if len(np.unique(mesh.positions, axis=0)) == len(mesh.positions):
        assert angles_deg(mesh, decoded).max() < (4.6 if kind == "image" else 1.2)


@given(seed=st.integers(0, 1 << 30), kind=st.sampled_from(["plain", "colours", "image", "wide"]))
def test_the_reader_of_the_specification_says_the_same(
    read_segment: Callable[[bytes], Any], seed: int, kind: str
) -> None:
    data = encode_segment(
        random_mesh(seed, 40, manifold=bool(seed % 5), kind=kind),
        step_m=STEP_M,
        scales=SCALES,
        may_be_wide=True,
    )
    mesh = decode_segment(data, scales=SCALES)
    faces, positions, _, colours, uvs, regions, image = read_segment(data)
    assert mesh.faces.tolist() == [list(face) for face in faces]
    assert mesh.positions.tolist() == [list(position) for position in positions]
    if mesh.colours is not None:
        assert mesh.colours.tolist() == [list(colour) for colour in colours]
    if mesh.uvs is not None and mesh.texture is not None:
        assert mesh.uvs.tolist() == [list(uv) for uv in uvs]
        assert image == mesh.texture.data
    if mesh.region_ids is not None:
        assert mesh.region_ids.tolist() == regions


@pytest.mark.parametrize("kind", ["plain", "colours", "image", "wide"])
def test_files_of_before_are_read(kind: str) -> None:
    data = (GOLDEN / f"{kind}.tsg").read_bytes()
    mesh = random_mesh(4, 50, manifold=True, kind=kind)
    assert np.array_equal(corner_rows(decode_segment(data, scales=SCALES)), corner_rows(mesh))


@pytest.mark.parametrize("kind", ["plain", "image"])
def test_no_damage_changes_a_mesh(kind: str) -> None:
    data = encode_segment(
        random_mesh(4, 12, manifold=True, kind=kind), step_m=STEP_M, scales=SCALES
    )
    whole = corner_rows(decode_segment(data, scales=SCALES))
    for offset in range(len(data)):
        broken = bytearray(data)
        broken[offset] ^= 0x10
        try:
            decoded = decode_segment(bytes(broken), scales=SCALES)
        except PayloadError:
            continue
        # Bits without a meaning: gzip's time of writing, codes of DEFLATE that nothing uses.
        assert np.array_equal(corner_rows(decoded), whole)
    for length in range(0, len(data), 7):
        with pytest.raises(PayloadError):
            decode_segment(data[:length], scales=SCALES)
    with pytest.raises(PayloadError):
        decode_segment(data + b"\0", scales=SCALES)


@given(
    faces=st.integers(1, 30), far=st.sampled_from([-(1 << 31), -(1 << 24), 1 << 24, (1 << 31) - 1])
)
def test_a_wide_mesh_beyond_the_grid_is_refused(faces: int, far: int) -> None:
    mesh = random_mesh(4, faces, manifold=True, kind="wide")
    data = encode_segment(mesh, step_m=STEP_M, scales=SCALES, may_be_wide=True)
    moved = with_stream(data, lambda stream: struct.pack_into("<i", stream, 8, far))
    with pytest.raises(PayloadError, match=r"2\^24 steps"):
        decode_segment(moved, scales=SCALES)


def with_stream(data: bytes, change: Callable[[bytearray], None]) -> bytes:
    """The segment with another stream, its checksum right."""
    (length,) = struct.unpack_from("<I", data, 4)
    stream = bytearray(gzip.decompress(data[12 : 12 + length]))
    change(stream)
    packed = gzip.compress(bytes(stream), mtime=0)
    return data[:4] + struct.pack("<I", len(packed)) + data[8:12] + packed + data[12 + length :]


@given(seed=st.integers(0, 1 << 30), count=st.integers(1, 4))
def test_a_hostile_stream_gives_a_mesh_or_a_refusal(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    mesh = random_mesh(seed, 20, manifold=True, kind="colours")
    data = encode_segment(mesh, step_m=STEP_M, scales=SCALES)

    def damage(stream: bytearray) -> None:
        for _ in range(count):
            stream[random.integers(len(stream))] = random.integers(256)

    try:
        decoded = decode_segment(with_stream(data, damage), scales=SCALES)
    except PayloadError:
        return
    assert decoded.faces.max() < len(decoded.positions)


def test_a_stream_that_grows_without_bound_is_refused() -> None:
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    block = bytes(1 << 24)
    packed = b"".join(packer.compress(block) for _ in range(MAX_STREAM_BYTES // len(block) + 1))
    packed += packer.flush()
    assert len(packed) < 1 << 19
    with pytest.raises(PayloadError, match="too long"):
        decode_segment(struct.pack("<4sII", b"TSG2", len(packed), 0) + packed, scales=SCALES)


def test_meshes_that_do_not_fit_are_refused(triangle: SegmentMesh) -> None:
    def encode(**changes: Any) -> bytes:
        return encode_segment(replace(triangle, **changes), step_m=STEP_M, scales=SCALES)

    with pytest.raises(PayloadError, match="65535"):
        encode(positions=triangle.positions * np.float32(257))
    with pytest.raises(PayloadError, match="4 vertices of which faces use 3"):
        encode(
            positions=np.vstack([triangle.positions, [[5, 5, 5]]]).astype(np.float32),
            normals=np.vstack([triangle.normals, [[0, 1, 0]]]).astype(np.float32),
        )
    with pytest.raises(PayloadError, match="expected some of the scene's"):
        encode(attributes={"clay": np.zeros(3, np.float32)})
    with pytest.raises(PayloadError, match="power of two"):
        encode_segment(triangle, step_m=0.003, scales={})


@pytest.mark.parametrize("kind", ["plain", "image"])
def test_the_shape_is_read_without_scales(kind: str) -> None:
    mesh = random_mesh(4, 12, manifold=True, kind=kind)
    data = encode_segment(mesh, step_m=STEP_M, scales=SCALES)
    bare = decode_segment(data, scales=None)
    assert bare.attributes == {}
    assert np.array_equal(corner_rows(bare), corner_rows(replace(mesh, attributes={})))
    assert segment_texture(data) == ((16, 8, 32) if kind == "image" else (0, 0, 0))


def test_a_scene_has_no_more_attributes_than_bits(triangle: SegmentMesh) -> None:
    names = [f"a{number}" for number in range(MAX_ATTRIBUTES + 1)]
    scales = {name: AttributeScale(0.0, 1.0) for name in names}
    last = {names[MAX_ATTRIBUTES - 1]: np.float32([1, 2, np.nan])}
    mesh = replace(triangle, attributes=last)
    with pytest.raises(PayloadError, match="there may be 32"):
        encode_segment(mesh, step_m=STEP_M, scales=scales)
    del scales[names[-1]]
    decoded = decode_segment(encode_segment(mesh, step_m=STEP_M, scales=scales), scales=scales)
    assert sorted(decoded.attributes) == sorted(last)


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("*.tsg")), ids=lambda path: path.name)
def test_the_box_is_that_of_the_decoded_positions(path: Path) -> None:
    positions = decode_segment(path.read_bytes(), scales=None).positions.astype(float)
    box = segment_bounds(path.read_bytes())
    assert box.tolist() == [*positions.min(axis=0), *positions.max(axis=0)]


def test_the_box_of_a_damaged_segment_is_refused() -> None:
    data = encode_segment(
        random_mesh(3, 50, manifold=True, kind="colours"), step_m=STEP_M, scales=SCALES
    )
    for at in range(0, len(data), 7):
        damaged = data[:at] + bytes([data[at] ^ 16]) + data[at + 1 :]
        try:
            box = segment_bounds(damaged)
        except PayloadError:
            continue
        # The gzip header has fields that say nothing.
        assert box.tolist() == segment_bounds(data).tolist()
