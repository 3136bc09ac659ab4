"""Every promise of the format, broken one at a time.

Each case rewrites one thing and then mends hashes and version, so that only the broken promise
itself can be noticed.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xxhash
from store.tiny_scene import SCALES, STEP_M, TinyScene, add_encoding, lattice_mesh

from terraport_payload import Cover, SegmentMesh, encode_segment
from terraport_store import (
    Finding,
    SceneNotFoundError,
    SegmentIndex,
    manifest_digest,
    validate_scene,
)
from terraport_store.layout import ENCODING


class Forger:
    """Rewrites a scene and makes everything fit again but what was broken."""

    def __init__(self, scene: TinyScene) -> None:
        self.path = scene.path
        self.document: dict[str, Any] = json.loads((scene.path / "scene.json").read_bytes())

    def file(self, key: str) -> Path:
        return self.path / self.document["files"][key]["path"]

    def index(self, encoding: str = ENCODING) -> SegmentIndex:
        key = "segments.idx" if encoding == ENCODING else f"segments.{encoding}.idx"
        return SegmentIndex.from_bytes(self.file(key).read_bytes())

    def write_index(self, index: SegmentIndex, encoding: str = ENCODING) -> None:
        key = "segments.idx" if encoding == ENCODING else f"segments.{encoding}.idx"
        self.file(key).write_bytes(index.to_bytes())

    def replace_payload(self, segment: int, payload: bytes, encoding: str = ENCODING) -> None:
        """Put another payload in a segment's place, with its hash and length right."""
        key = "segments.pack" if encoding == ENCODING else f"segments.{encoding}.pack"
        index, pack = self.index(encoding), self.file(key).read_bytes()
        payloads = [
            pack[int(o) : int(o) + int(n)] for o, n in zip(index.offset, index.length, strict=True)
        ]
        payloads[segment] = payload
        out, offsets = bytearray(pack[:64]), []
        for blob in payloads:
            out += bytes(-len(out) % 64)
            offsets.append(len(out))
            out += blob
        self.file(key).write_bytes(bytes(out))
        self.write_index(
            replace(
                index,
                offset=np.array(offsets, dtype=np.uint64),
                length=np.array([len(blob) for blob in payloads], dtype=np.uint32),
                xxh3=np.array([xxhash.xxh3_64_intdigest(p) for p in payloads], dtype=np.uint64),
            ),
            encoding,
        )
        self.document["encodings"][encoding]["payload_bytes"] = sum(map(len, payloads))
        longest = max(int(self.index(name).length.max()) for name in self.document["encodings"])
        self.document["limits"]["max_segment_bytes"] = longest

    def seal(self) -> list[Finding]:
        """Mend sizes, hashes and version, then validate."""
        for file in self.document["files"].values():
            data = (self.path / file["path"]).read_bytes()
            file["bytes"], file["xxh3"] = len(data), xxhash.xxh3_64_hexdigest(data)
        self.document["version"] = manifest_digest(self.document)
        return self.validate()

    def validate(self) -> list[Finding]:
        (self.path / "scene.json").write_text(json.dumps(self.document))
        return validate_scene(self.path)


def encode(mesh: SegmentMesh, **options: Any) -> bytes:
    return encode_segment(mesh, **{"step_m": STEP_M, "scales": SCALES, **options})


def codes(findings: list[Finding]) -> set[str]:
    return {finding.code for finding in findings}


def test_whole_scene_has_no_finding(tiny: TinyScene) -> None:
    calls: list[tuple[int, int]] = []
    findings = validate_scene(tiny.path, progress=lambda *done: calls.append(done))
    assert findings == []
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_forging_nothing_has_no_finding(tiny: TinyScene) -> None:
    """What the cases below find is not the forger's own doing."""
    forger = Forger(tiny)
    forger.replace_payload(1, tiny.payloads[1])
    forger.write_index(forger.index())
    assert forger.seal() == []


def test_no_scene(tmp_path: Path) -> None:
    with pytest.raises(SceneNotFoundError):
        validate_scene(tmp_path)


def test_unreadable_manifest_is_one_finding(tiny: TinyScene) -> None:
    (tiny.path / "scene.json").write_text("{")
    (finding,) = validate_scene(tiny.path)
    assert finding.code == "manifest"
    assert str(finding).startswith("error manifest: scene.json: does not parse as JSON")


@pytest.mark.parametrize(
    "name", ["base.cover", "base.tsg", "regions.json", "segments.idx", "segments.pack"]
)
def test_every_flipped_byte_of_every_file_is_found(tiny: TinyScene, name: str) -> None:
    path = tiny.path / tiny.manifest.files[name].path
    good = path.read_bytes()
    for offset in {*range(0, len(good), max(1, len(good) // 12)), len(good) - 1}:
        damaged = bytearray(good)
        damaged[offset] ^= 0x08
        path.write_bytes(bytes(damaged))
        assert "file-hash" in codes(validate_scene(tiny.path)), offset
    path.write_bytes(good)
    assert validate_scene(tiny.path) == []


def test_flipped_payload_byte_names_the_segment(tiny: TinyScene) -> None:
    path = tiny.path / tiny.manifest.files["segments.pack"].path
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(bytes(data))
    findings = [finding for finding in validate_scene(tiny.path) if finding.code == "payload-hash"]
    assert [finding.segment for finding in findings] == [3]
    assert "segment 3 has hash" in findings[0].message
    assert findings[0].offset is not None


def test_missing_and_shortened_files(tiny: TinyScene) -> None:
    pack = tiny.path / tiny.manifest.files["segments.pack"].path
    pack.write_bytes(pack.read_bytes()[:-5])
    assert codes(validate_scene(tiny.path)) == {"file-size", "open"}
    pack.unlink()
    assert codes(validate_scene(tiny.path)) == {"file-missing", "open"}


@pytest.mark.parametrize(
    ("path", "value", "code", "message"),
    [
        (["name"], "renamed", "version", "by its contents"),
        (["step_m"], 2.0**-11, "grid", "off the grid, expected multiples of 0.00048828125 m"),
        (["bounds", "max", 1], 99.0, "bounds", "by index and base"),
        (["counts", "detail_faces"], 287, "count", "counts.detail_faces 287, expected 288"),
        (["counts", "detail_vertices"], 1, "count", "counts.detail_vertices 1, expected 196"),
        (["counts", "base_vertices"], 24, "base-count", "25 vertices and 32 faces, expected 24"),
        (["counts", "regions"], 2, "region", "region 2, expected below 2"),
        (["limits", "max_segment_faces"], 71, "count", "limits.max_segment_faces 71, expected 72"),
        (["limits", "max_segment_bytes"], 1, "count", "limits.max_segment_bytes 1"),
        (["limits", "max_extent_m"], 9.0, "count", "limits.max_extent_m 9.0, expected 1.5"),
        (
            ["encodings", ENCODING, "payload_bytes"],
            1,
            "count",
            "encodings.segment-2.payload_bytes 1",
        ),
        (
            ["attributes"],
            [],
            "base-decode payload-decode",
            "attributes 0x1, expected some of the scene's 0",
        ),
        (["attributes", 0, "max"], 0.5, "attribute-range", "expected within 0.0 to 0.5"),
        (["attributes", 0, "max"], None, "attribute-range", "expected within 0.0 to None"),
    ],
)
def test_manifest_that_says_something_else(
    tiny: TinyScene, path: list[Any], value: object, code: str, message: str
) -> None:
    forger = Forger(tiny)
    node: Any = forger.document
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    findings = forger.validate() if code == "version" else forger.seal()
    assert codes(findings) == set(code.split())
    assert message in findings[0].message


def test_step_that_is_no_power_of_two(tiny: TinyScene) -> None:
    forger = Forger(tiny)
    forger.document["step_m"] = 0.3
    assert codes(forger.seal()) == {"step", "grid"}


def test_files_in_two_folders(tiny: TinyScene) -> None:
    forger = Forger(tiny)
    (tiny.path / "other").mkdir()
    forger.file("base.cover").rename(tiny.path / "other" / "base.cover")
    forger.document["files"]["base.cover"]["path"] = "other/base.cover"
    assert codes(forger.seal()) == {"folder"}


def shifted(mesh: SegmentMesh) -> SegmentMesh:
    return replace(mesh, positions=mesh.positions + np.float32(0.25))


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda mesh: encode(shifted(mesh)), {"payload-bounds"}),
        (lambda mesh: encode(replace(mesh, faces=mesh.faces[:-1])), {"payload-count"}),
        (lambda mesh: encode(replace(mesh, colours=None)), {"colour"}),
        (
            lambda mesh: encode(
                replace(mesh, attributes={"height_change_m": mesh.positions[:, 0]})
            ),
            {"payload-decode"},
        ),
        (
            lambda mesh: encode(replace(mesh, region_ids=mesh.region_ids + np.uint16(1))),
            {"payload-region"},
        ),
        (
            lambda mesh: encode(replace(mesh, region_ids=np.full(49, 9, dtype=np.uint16))),
            {"payload-region", "region"},
        ),
        (lambda mesh: encode(mesh, step_m=2.0**-14), {"grid", "payload-bounds"}),
        (
            lambda mesh: encode(
                replace(mesh, positions=mesh.positions * np.float32(64)), may_be_wide=True
            ),
            {"payload-bounds", "wide"},
        ),
        (lambda _: b"glTF, or so it says", {"payload-decode"}),
    ],
)
def test_payload_that_is_not_what_the_index_says(
    tiny: TinyScene, make: Callable[[SegmentMesh], bytes], expected: set[str]
) -> None:
    forger = Forger(tiny)
    forger.replace_payload(1, make(lattice_mesh(0, 6)))
    findings = forger.seal()
    assert codes(findings) == expected
    assert {finding.segment for finding in findings} == {1}


def test_an_attribute_without_a_value_may_be_left_out(tiny: TinyScene) -> None:
    forger = Forger(tiny)
    forger.replace_payload(1, encode(replace(lattice_mesh(0, 6), attributes={})))
    assert forger.seal() == []


def test_indexes_that_differ(tiny: TinyScene) -> None:
    """Of a scene with an encoding of a later version of the format."""
    add_encoding(tiny)
    forger = Forger(tiny)
    index = forger.index("later")
    forger.write_index(replace(index, region=index.region[::-1].copy()), "later")
    findings = forger.seal()
    assert codes(findings) == {"index-agreement"}
    assert "region differ from the segment-2 index" in findings[0].message


@pytest.mark.parametrize("beyond", [3, 7])
def test_index_with_wrong_region(tiny: TinyScene, beyond: int) -> None:
    """The scene has regions 0, 1 and 2."""
    forger = Forger(tiny)
    region = np.array([0, 1, 1, beyond], dtype=np.uint32)
    forger.write_index(replace(forger.index(), region=region))
    assert codes(forger.seal()) == {"region", "payload-region"}


def test_gap_in_the_pack_that_is_not_zero(tiny: TinyScene) -> None:
    forger = Forger(tiny)
    index = forger.index()
    ends = index.offset.astype(np.int64) + index.length
    gaps = np.flatnonzero(ends[:-1] < index.offset[1:].astype(np.int64))
    assert len(gaps), "every payload of the tiny scene is a whole number of alignments long"
    end, after = int(ends[gaps[0]]), int(gaps[0]) + 1
    pack = bytearray(forger.file("segments.pack").read_bytes())
    pack[end] = 1
    forger.file("segments.pack").write_bytes(bytes(pack))
    findings = forger.seal()
    assert codes(findings) == {"padding"}
    assert (findings[0].segment, findings[0].offset) == (after, end)


def test_bytes_after_the_last_payload(tiny: TinyScene) -> None:
    forger = Forger(tiny)
    with forger.file("segments.pack").open("ab") as file:
        file.write(b"\0")
    assert codes(forger.seal()) == {"pack-end"}


def test_cover_that_names_too_much_or_too_little(tiny: TinyScene) -> None:
    forger = Forger(tiny)
    rows = np.full(32, 4, dtype=np.uint32)
    forger.file("base.cover").write_bytes(Cover(np.arange(33, dtype=np.uint32), rows).to_bytes())
    (finding,) = forger.seal()
    assert (finding.code, finding.message) == ("open", "segment 4, expected below 4")
    short = Cover(np.zeros(32, dtype=np.uint32), np.zeros(0, dtype=np.uint32))
    forger.file("base.cover").write_bytes(short.to_bytes())
    (finding,) = forger.seal()
    assert (finding.code, finding.message[:13]) == ("open", "cover of 31 b")


@pytest.mark.parametrize("data", [b"[]", b"{", b"\xff"])
def test_regions_that_are_no_object(tiny: TinyScene, data: bytes) -> None:
    forger = Forger(tiny)
    forger.file("regions.json").write_bytes(data)
    assert codes(forger.seal()) == {"regions"}


def test_base_that_does_not_decode(tiny: TinyScene) -> None:
    forger = Forger(tiny)
    forger.file("base.tsg").write_bytes(b"glTF")
    assert codes(forger.seal()) == {"base-decode"}


def test_findings_are_bounded(tmp_path: Path) -> None:
    """A scene with everything wrong does not fill the memory."""
    from store.tiny_scene import write_tiny_scene

    from terraport_store.findings import MAX_FINDINGS

    scene = write_tiny_scene(tmp_path / "s", copies=260)
    forger = Forger(scene)
    forger.document["attributes"] = []
    assert len(forger.seal()) == MAX_FINDINGS
