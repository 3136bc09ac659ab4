from __future__ import annotations

import copy
import json
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from store.tiny_scene import SCALES, STEP_M, lattice_mesh

from terraport_payload import PayloadError, decode_glb, encode_glb
from terraport_payload.glb_container import join_glb, split_glb

GOOD = encode_glb(lattice_mesh(0, 0, 3), step_m=STEP_M, attribute_scales=SCALES)
PLAIN = encode_glb(lattice_mesh(0, 0, 3), step_m=STEP_M, attribute_scales=SCALES, compress=False)
DOCUMENT, BINARY, BINARY_AT = split_glb(GOOD)
PLAIN_DOCUMENT, PLAIN_BINARY, _ = split_glb(PLAIN)


def with_change(change: Callable[[dict[str, Any]], object], *, plain: bool = False) -> bytes:
    """A GLB whose document was changed and whose container is whole."""
    document = copy.deepcopy(PLAIN_DOCUMENT if plain else DOCUMENT)
    change(document)
    return join_glb(document, bytes(PLAIN_BINARY if plain else BINARY))


def set_at(*path: Any) -> Callable[[dict[str, Any]], None]:
    """Put the last argument at the path that the others are."""
    *keys, last, value = path

    def change(document: dict[str, Any]) -> None:
        owner: Any = document
        for key in keys:
            owner = owner[key]
        owner[last] = value

    return change


EXT = "EXT_meshopt_compression"
PRIMITIVE = ("meshes", 0, "primitives", 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            set_at("extensionsRequired", ["KHR_draco_mesh_compression"]),
            "'KHR_draco_mesh_compression'",
        ),
        (set_at("extensionsRequired", 3), "extensionsRequired is int, expected list"),
        (set_at("extensionsRequired", [[]]), "required extension"),
        (set_at("meshes", []), "0 meshes, expected 1"),
        (set_at("meshes", {}), "meshes is dict, expected list"),
        (set_at("nodes", 0, {"mesh": 0, "matrix": []}), "matrix or rotation"),
        (set_at("nodes", 0, "scale", [1, 1, 0]), "expected positive numbers"),
        (set_at("nodes", 0, "scale", [1, 1]), "scale has 2 numbers"),
        (set_at("nodes", 0, "translation", [1, 1, "x"]), "'x', expected a number"),
        (set_at("nodes", 0, "translation", [1, 1, 10**400]), "not finite"),
        (set_at("nodes", 0, "translation", [0, 0, 1e300]), "expected finite numbers"),
        (set_at(*PRIMITIVE, "mode", 1), "primitive mode 1, expected 4"),
        (set_at(*PRIMITIVE, "attributes", None), "attributes is NoneType"),
        (
            set_at(*PRIMITIVE, "attributes", "POSITION", 99),
            "accessor of POSITION is 99, expected 0 to 5",
        ),
        (set_at(*PRIMITIVE, "attributes", "POSITION", True), "accessor of POSITION is True"),
        (set_at(*PRIMITIVE, "attributes", "POSITION", 1), "POSITION is 5120"),
        (set_at(*PRIMITIVE, "indices", 0), "indices is 5123 'VEC3', expected SCALAR"),
        (set_at(*PRIMITIVE, "indices", None), "accessor of indices is None"),
        (set_at("accessors", 0, "count", -1), "count of POSITION is -1"),
        (set_at("accessors", 0, "count", 1e3), "count of POSITION is 1000.0"),
        (set_at("accessors", 0, "count", 10**9), r"expected 1000000000 rows of 8|compressed as"),
        (set_at("accessors", 0, "count", 10**30), "expected a whole number"),
        (set_at("accessors", 0, "byteOffset", 4), "has an offset inside its bufferView"),
        (set_at("accessors", 0, "sparse", {}), "is sparse"),
        (set_at("accessors", 0, "componentType", {}), "POSITION is {}"),
        (set_at("accessors", 0, "bufferView", 77), "bufferView of POSITION is 77"),
        (set_at("accessors", 2, "count", 15), "COLOR_0"),
        (set_at("bufferViews", 0, "byteStride", 260), "byteStride of POSITION is 260"),
        (set_at("bufferViews", 0, "byteStride", 6), "byteStride of POSITION is 6"),
        (set_at("bufferViews", 0, "byteLength", 7), "7 bytes, expected 16 rows of 8"),
        (set_at("bufferViews", 0, "extensions", EXT, "mode", "INDICES"), "compressed as"),
        (
            set_at("bufferViews", 0, "extensions", EXT, "filter", "COLOR"),
            "filter 'COLOR' of POSITION",
        ),
        (set_at("bufferViews", 0, "extensions", EXT, "filter", []), r"filter \[\] of POSITION"),
        (set_at("bufferViews", 0, "extensions", EXT, "byteOffset", 10**6), "lies at 1000000"),
        (set_at("bufferViews", 0, "extensions", EXT, "byteOffset", 1), "codec byte"),
        (set_at("bufferViews", 0, "extensions", EXT, "byteLength", 9), "does not decompress"),
        (set_at("bufferViews", 0, "extensions", EXT, "byteLength", 1), "expected at least 2"),
        (set_at("bufferViews", 0, "extensions", EXT, "buffer", 1), "in buffer 1, expected 0"),
        (set_at("meshes", 0, "extras", "terraport", "attributes", 0, "step", 0), "step=0"),
        (set_at("meshes", 0, "extras", "terraport", "attributes", 0, "null", 0), "null code 0"),
        (
            set_at("meshes", 0, "extras", "terraport", "attributes", 0, "name", 1),
            "attribute names 1",
        ),
        (
            set_at("meshes", 0, "extras", "terraport", "attributes", 0, "gltf_name", "_X"),
            "accessor of _X",
        ),
        (set_at("meshes", 0, "extras", []), "extras is list"),
    ],
)
def test_hostile_documents(change: Callable[[dict[str, Any]], None], message: str) -> None:
    with pytest.raises(PayloadError, match=message):
        decode_glb(with_change(change))


def test_unchanged_documents_decode() -> None:
    """The changes above are what makes the difference."""
    assert len(decode_glb(with_change(lambda _: None)).faces) == 18
    assert len(decode_glb(with_change(lambda _: None, plain=True)).faces) == 18


def test_promised_rows_are_not_allocated() -> None:
    """A payload of 4 KiB that claims 100 million vertices is refused before memory is taken."""

    def change(document: dict[str, Any]) -> None:
        count = 100_000_000
        document["accessors"][0]["count"] = count
        view = document["bufferViews"][0]
        view["byteLength"] = count * 8
        view["extensions"][EXT]["count"] = count

    data = with_change(change)
    tracemalloc.start()
    try:
        with pytest.raises(PayloadError, match="expected at least 12500000"):
            decode_glb(data)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


def test_index_beyond_the_vertices_is_refused() -> None:
    def change(document: dict[str, Any]) -> None:
        """Fewer vertices than the indices use."""
        for view, accessor in zip(
            document["bufferViews"][:-1], document["accessors"][:-1], strict=True
        ):
            accessor["count"] = 8
            view["byteLength"] = 8 * view["byteStride"]

    with pytest.raises(PayloadError, match="a face uses vertex 15, expected below 8"):
        decode_glb(with_change(change, plain=True))


def test_every_truncation_fails() -> None:
    for size in range(len(GOOD)):
        with pytest.raises(PayloadError):
            decode_glb(GOOD[:size])


def test_every_flipped_byte_decodes_or_is_named() -> None:
    """Hashes find flipped bytes; the decoder has only to stay safe: a mesh or PayloadError, nothing
    else."""
    refused = 0
    for position in range(len(GOOD)):
        for mask in (0x01, 0x80, 0xFF):
            damaged = bytearray(GOOD)
            damaged[position] ^= mask
            try:
                mesh = decode_glb(bytes(damaged))
            except PayloadError:
                refused += 1
            else:
                assert mesh.faces.max() < len(mesh.positions)
                assert np.isfinite(mesh.positions).all()
    assert refused > len(GOOD)


numbers = st.integers() | st.floats(allow_nan=False, allow_infinity=False)
json_values = st.recursive(
    st.none() | st.booleans() | numbers | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=5,
)


def paths_of(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every path in a document."""
    paths = [path] if path else []
    items: Any = ()
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list):
        items = enumerate(value)
    for key, inner in items:
        paths += paths_of(inner, (*path, key))
    return paths


@given(st.sampled_from(paths_of(DOCUMENT)), json_values)
@settings(max_examples=300)
def test_any_json_anywhere_decodes_or_is_named(path: tuple[Any, ...], value: Any) -> None:
    try:
        data = with_change(set_at(*path, value))
        mesh = decode_glb(data)
    except PayloadError:
        return
    assert mesh.faces.max() < len(mesh.positions)


def test_normals_are_those_of_numpys_norm_to_the_bit() -> None:
    document = copy.deepcopy(PLAIN_DOCUMENT)
    accessor = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]]
    at, count = document["bufferViews"][accessor["bufferView"]]["byteOffset"], accessor["count"]
    draw = np.random.default_rng(3)
    for _ in range(50):
        signed = draw.integers(-128, 128, (count, 4)).astype(np.int8)
        signed[:3, :3] = [[-128, 127, 0], [0, 0, -128], [1, 0, 0]]
        binary = bytearray(PLAIN_BINARY)
        binary[at : at + 4 * count] = signed.tobytes()
        values = np.maximum(signed[:, :3].astype(np.float32) / np.float32(127), np.float32(-1))
        expected = values / np.linalg.norm(values, axis=1, keepdims=True)
        normals = decode_glb(join_glb(document, bytes(binary))).normals
        assert normals.tobytes() == expected.astype(np.float32).tobytes()


@given(st.binary(max_size=300))
def test_any_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(PayloadError):
        decode_glb(data)


@given(st.integers(BINARY_AT, len(GOOD) - 1), st.binary(min_size=1, max_size=40))
@settings(max_examples=300)
def test_any_bytes_in_the_streams_decode_or_are_named(at: int, noise: bytes) -> None:
    data = (GOOD[:at] + noise + GOOD[at + len(noise) :])[: len(GOOD)]
    try:
        mesh = decode_glb(data)
    except PayloadError:
        return
    assert mesh.faces.max() < len(mesh.positions)


def test_memoryview_is_read_like_bytes() -> None:
    assert np.array_equal(decode_glb(memoryview(GOOD)).faces, decode_glb(GOOD).faces)


def test_document_is_ascii_json_without_surprises() -> None:
    """What is damaged above is what is written: one JSON chunk, compact."""
    length = int.from_bytes(GOOD[12:16], "little")
    assert json.loads(GOOD[20 : 20 + length]) == DOCUMENT
