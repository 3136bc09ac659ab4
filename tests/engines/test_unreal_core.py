"""The Unreal plugin's core, without the engine: messages, payloads and histories of the corpora."""

from __future__ import annotations

import base64
import gzip
import json
import struct
import zlib
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from conformance.landings_steps import CORPUS as LANDINGS
from conformance.landings_steps import read_histories, sent_message
from engines.unreal import CoreTool, Unreal

from terraport_payload import SegmentMesh

CONFORMANCE = LANDINGS.parent
PAYLOADS = CONFORMANCE / "scene" / "payload"
GOLDEN = CONFORMANCE.parent / "payload" / "golden_segments"
ROUNDED = 4e-6
"""The corpus rounds to six digits."""


@pytest.fixture(scope="module")
def tool(unreal: Unreal) -> Any:
    with CoreTool(unreal) as running:
        yield running


# ---- messages


def message_cases() -> list[dict[str, Any]]:
    lines = [
        line
        for path in sorted((CONFORMANCE / "messages").glob("*.jsonl"))
        for line in path.read_text(encoding="utf-8").splitlines()
    ]
    return [json.loads(line) for line in lines]


def in_hex(value: Any, name: str = "") -> Any:
    """Turn binaries, in base64 in the corpus, into hexadecimal digits."""
    if isinstance(value, dict):
        return {key: in_hex(item, key) for key, item in value.items()}
    if name in {"show", "hidden", "inner_hidden", "missing", "data"} and isinstance(value, str):
        return base64.b64decode(value).hex()
    return value


def includes(read: Any, expected: Any) -> bool:
    """Return whether every field that was read is as the corpus has it."""
    if not isinstance(read, dict) or not isinstance(expected, dict):
        return bool(read == expected)
    return all(includes(value, expected.get(name)) for name, value in read.items())


@pytest.mark.parametrize("sender", ["server", "client"])
def test_messages(tool: CoreTool, sender: str) -> None:
    cases = [case for case in message_cases() if case["from"] == sender]
    assert len(cases) > 60
    for case in cases:
        data = base64.b64decode(case["bytes"])
        data = data.ljust(case.get("pad_to", 0), bytes([case.get("pad_byte", 0)]))
        if sender == "server":
            difference = misread(tool.ask(f"server {data.hex()}"), case)
            assert difference is None, f"{case['case']}: {difference}"
        elif "message" in case:
            written = bytes.fromhex(tool.ask(f"client {data.hex()}")["written"])
            if written:  # It never sends the others: a gather with a deadline.
                expected = {name: item for name, item in case["message"].items() if item != ""}
                read = plain(msgpack.unpackb(written))
                assert {name: read[name] for name in read if read[name] != ""} == expected


def plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    return base64.b64encode(value).decode() if isinstance(value, bytes) else value


def misread(answer: dict[str, Any], case: dict[str, Any]) -> str | None:
    if "refused_by" in case:
        return None if "refused" in answer else f"read as {answer}"
    if "skip" in case:
        return None if "skip" in answer else f"got {answer}, expected it to be skipped"
    kind = "frame" if "frame" in case else "message"
    expected = in_hex(case[kind])
    if kind not in answer:
        return f"got {answer}"
    read = answer[kind]
    if read.get("ready") is not None:  # Tables of numbers, as lists.
        for name in ("ready", "degraded", "missing"):
            expected[name] = np.frombuffer(base64.b64decode(case[kind][name]), "<u4").tolist()
    required = set(expected) - {"type", "version", "server", "session", "pack", "offsets"}
    if not required <= set(read):
        return f"lacks {required - set(read)}"
    return None if includes(read, expected) else f"read {read}, expected {expected}"


def test_a_map_or_list_has_at_most_16384_items(tool: CoreTool) -> None:
    notice: dict[str, Any] = {"type": "notice", "kind": "draining"}
    for count in (16384, 16385):
        names = {str(number): None for number in range(count)}
        for later in ([None] * count, names):
            answer = tool.ask(f"server {msgpack.packb({**notice, 'later': later}).hex()}")
            assert ("message" in answer) == (count == 16384), answer


def test_a_group_has_up_to_1024_members(tool: CoreTool) -> None:
    for count in (1024, 1025):
        numbers = list(range(1, count + 1))
        members = [{"member": n, "role": "member", "present": True} for n in numbers]
        data = msgpack.packb({"type": "roster", "group": "all", "members": members})
        assert ("message" in tool.ask(f"server {data.hex()}")) == (count == 1024)
        table = struct.pack(f"<{count}I", *numbers)
        gathered = {"type": "gathered", "gathering": 1, "ready": table}
        data = msgpack.packb(gathered | {"degraded": b"", "missing": b""})
        assert ("message" in tool.ask(f"server {data.hex()}")) == (count == 1024)


# ---- payloads


def decoded(tool: CoreTool, path: Path, scales: list[dict[str, Any]], kind: str = "segment") -> Any:
    answer = tool.ask(f"{kind} {path} {len(scales)}")
    if "refused" in answer:
        return answer
    columns = {}
    for scale, column in zip(scales, answer["attributes"], strict=True):
        codes = np.array(column["codes"])
        if len(codes):
            values = (scale["offset"] + scale["step"] * codes).astype("<f4")
            columns[scale["name"]] = np.where(codes == 65535, np.float32(np.nan), values)
    normals = np.array(answer["normals"], np.float32).reshape(-1, 3)
    return answer | {
        "positions": np.array(answer["positions"], "<f4").reshape(-1, 3),
        "faces": np.array(answer["faces"]).reshape(-1, 3),
        "normals": normals / np.linalg.norm(normals, axis=1, keepdims=True),
        "colours": np.array(answer["colours"]).reshape(-1, 3),
        "uvs": np.array(answer["uvs"], "<f4").reshape(-1, 2),
        "attributes": columns,
    }


def same_mesh(read: Any, mesh: SegmentMesh) -> None:
    """Array for array as the Python decoder, bit for bit but for the length of normals."""
    np.testing.assert_array_equal(read["positions"], mesh.positions)
    np.testing.assert_array_equal(read["faces"], mesh.faces)
    np.testing.assert_allclose(read["normals"], mesh.normals, atol=1e-6)
    for name in ("colours", "uvs", "region_ids"):
        expected = getattr(mesh, name)
        if expected is None:
            assert len(read[name]) == 0
        else:
            np.testing.assert_array_equal(read[name], expected)
    assert set(read["attributes"]) == set(mesh.attributes)
    for name, values in mesh.attributes.items():
        np.testing.assert_array_equal(read["attributes"][name], values)
    texture = mesh.texture
    assert read["media_type"] == ("" if texture is None else texture.media_type)
    if texture is not None:
        assert (read["width"], read["height"]) == (texture.width, texture.height)
        assert read["image_crc"] == zlib.crc32(texture.data)
    assert read["low"] == mesh.positions.min(axis=0).tolist()
    assert read["high"] == mesh.positions.max(axis=0).tolist()


@pytest.mark.parametrize("path", sorted(PAYLOADS.glob("*.tsg")), ids=lambda path: path.stem)
def test_payload(tool: CoreTool, path: Path) -> None:
    expected = json.loads(path.with_name(f"{path.name}.json").read_text())
    kind = "base" if "wide" in path.stem else "segment"
    read = decoded(tool, path, expected["scales"], kind)
    assert ("refused" not in read) == expected["good"]
    if not expected["good"]:
        return
    for name, tolerance in (("positions", 0), ("faces", 0), ("normals", ROUNDED), ("uvs", ROUNDED)):
        wanted = expected.get(name) or np.zeros((0, 2))
        np.testing.assert_allclose(read[name], wanted, atol=tolerance)
    for name in ("colours", "region_ids"):
        np.testing.assert_array_equal(read[name], expected[name] or np.zeros(np.shape(read[name])))
    assert set(read["attributes"]) == set(expected["attributes"])
    for name, values in expected["attributes"].items():
        np.testing.assert_allclose(read["attributes"][name], np.array(values, float), rtol=1e-7)
    if expected.get("texture"):
        assert read["media_type"] == expected["texture"]["media_type"]
        assert read["gpu_bytes"] == expected["texture"]["gpu_bytes"]


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("*.tsg")), ids=lambda path: path.stem)
def test_a_base_may_be_wide_and_a_segment_may_not(tool: CoreTool, path: Path) -> None:
    answer = tool.ask(f"base {path} 32")
    assert "refused" not in answer
    assert ("refused" in tool.ask(f"segment {path} 32")) == (path.stem == "wide")


# ---- histories


@pytest.mark.parametrize("theme", sorted(path.stem for path in LANDINGS.glob("*.jsonl")))
def test_histories(tool: CoreTool, theme: str) -> None:
    histories = read_histories(LANDINGS / f"{theme}.jsonl")
    assert len(histories) >= 25
    for history in histories:
        assert difference(tool, history) is None, history["history"]


def difference(tool: CoreTool, history: dict[str, Any]) -> str | None:
    """Play a history; return where it goes another way, or None."""
    options = history["options"]
    most = options["max_segments"]
    tool.ask(f"begin {options['credit_bytes']} {-1 if most is None else most}")
    before: dict[str, Any] = {"shown": [], "hidden": 0}
    for number, (do, *given, told) in enumerate(history["steps"]):
        actual = tool.ask(f"{do} {arguments(do, given)}")
        state = {"shown": sorted(actual.pop("shown")), "hidden": actual.pop("hidden")}
        actual |= {name: value for name, value in state.items() if value != before[name]}
        before = state
        if "hidden" in actual:
            actual["hidden"] = f"{actual['hidden']:08x}"
        if "inner" in actual:
            actual["inner"] = [actual["inner"][0], f"{actual['inner'][1]:08x}"]
        if "sent" in actual:
            actual["sent"] = [sent_message(bytes.fromhex(each)) for each in actual["sent"]]
        if actual != told:
            return f"step {number} {do} {str(given)[:60]}: got {actual}, expected {told}"
    return None


def arguments(do: str, given: list[Any]) -> str:
    if do == "receive":
        return base64.b64decode(given[0]).hex()
    flat = [item for each in given for item in (each if isinstance(each, list) else [each])]
    return " ".join("-1" if item is None else repr(item) for item in flat)


WELCOME: dict[str, Any] = {
    "type": "welcome",
    "server": "test",
    "session": "1",
    "scene": {
        "id": "s",
        "name": "",
        "version": "1",
        "segment_count": 100,
        "base_faces": 8,
        "levels": 1,
    },
    "limits": {
        "max_radius_m": 1000,
        "max_message_bytes": 1 << 20,
        "max_messages_per_s": 100,
        "max_credit_bytes": 1 << 24,
        "idle_timeout_s": 60,
        "groups": "none",
    },
}


@pytest.mark.parametrize("damaged", [64, 65])
def test_a_landing_is_given_up_where_too_many_segments_are_damaged(
    tool: CoreTool, damaged: int
) -> None:
    """As many as `without` may name are left out; beyond that the user is told."""

    def receive(data: bytes) -> Any:
        return tool.ask(f"receive {data.hex()}")

    def send() -> list[Any]:
        sent = tool.ask("send")["sent"]
        return [sent_message(bytes.fromhex(each)) for each in sent]

    tool.ask(f"begin {1 << 24} -1")
    tool.ask("connected")
    send()
    receive(msgpack.packb(WELCOME))
    tool.ask("land 0 0 0 100 -1 -1")
    plan = {"type": "plan", "hidden": gzip.compress(b"\0"), "effective_radius_m": 100, "omitted": 0}
    rows = [struct.pack("<Q5I", key, key, 1, 1, 1, 1) for key in range(damaged)]
    for generation in (1, 2):
        assert len(send()) == 1
        receive(msgpack.packb(plan | {"generation": generation, "show": b"".join(rows)}))
        for key in range(damaged):
            receive(struct.pack("<BBHIQII", 1, 0, 24, generation, key, 0, 1) + b"?")
        told = receive(msgpack.packb({"type": "ready", "generation": generation}))
        assert ("given_up" in told) == (generation == 2 and damaged == 65)
    if damaged == 65:
        assert told["given_up"].startswith("got 65 damaged segments, expected at most 64;")
        assert send() == []
        tool.ask("land 0 0 0 100 -1 -1")
    (land,) = send()
    assert len(land.get("without", [])) == (64 if damaged == 64 else 0)


# ---- speed


def test_decoding_is_fast_and_allocates_nothing_in_the_steady_state(
    tool: CoreTool, tmp_path: Path
) -> None:
    paths = [path for path in PAYLOADS.glob("good-*.tsg") if "wide" not in path.stem]
    (tmp_path / "all").write_bytes(b"".join(path.read_bytes() for path in paths))
    told = tool.ask(f"speed {tmp_path / 'all'} 2 0.3")
    assert told["allocations"] == 0
    assert told["segments_per_s"] > 1000
