"""Khronos' glTF validator finds no error, and meshoptimizer's JavaScript decoder reads our buffers.

Needs node and npm; the two packages are installed once, below the system's temporary directory.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from glb_file import read_glb
from payload.images import pillow
from store.tiny_scene import SCALES, STEP_M, lattice_mesh, textured

from terraport_payload import SegmentMesh, encode_glb

CACHE = Path(tempfile.gettempdir()) / f"terraport-node-{os.getuid()}"
PACKAGES = ["gltf-validator@2.0.0-dev.3.10", "meshoptimizer@0.22.0"]

VALIDATE = """
import { readFileSync } from "node:fs";
import validator from "gltf-validator";
const reports = [];
for (const path of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(path)));
  reports.push(report.issues);
}
console.log(JSON.stringify(reports));
"""

DECODE = """
import { readFileSync } from "node:fs";
import { MeshoptDecoder } from "meshoptimizer";
await MeshoptDecoder.ready;
const data = readFileSync(process.argv[2]);
const length = data.readUInt32LE(12);
const document = JSON.parse(data.subarray(20, 20 + length));
const binary = data.subarray(28 + length);
const views = document.bufferViews.map((view) => {
  const packed = view.extensions.EXT_meshopt_compression;
  const target = new Uint8Array(packed.count * packed.byteStride);
  const start = packed.byteOffset ?? 0;
  const source = binary.subarray(start, start + packed.byteLength);
  MeshoptDecoder.decodeGltfBuffer(
    target, packed.count, packed.byteStride, source, packed.mode, packed.filter);
  return Buffer.from(target).toString("hex");
});
console.log(JSON.stringify({ document, views }));
"""


@pytest.fixture(scope="module")
def node_folder() -> Path:
    """A folder with the two packages; skips where they cannot be had."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        pytest.skip("node and npm are not installed")
    if not (CACHE / "node_modules").is_dir():
        fresh = Path(tempfile.mkdtemp(prefix="terraport-node-"))
        command = ["npm", "install", "--no-audit", "--no-fund", "--prefix", str(fresh), *PACKAGES]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=120)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
            shutil.rmtree(fresh, ignore_errors=True)
            pytest.skip(f"npm cannot install {PACKAGES}: {type(error).__name__}")
        try:
            fresh.rename(CACHE)
        except OSError:  # another run was quicker
            shutil.rmtree(fresh, ignore_errors=True)
    return CACHE


def run_node(folder: Path, name: str, script: str, *paths: Path) -> object:
    """Run a script beside the packages and parse what it prints."""
    path = folder / name
    path.write_text(script)
    command = ["node", str(path), *map(str, paths)]
    done = subprocess.run(command, check=True, capture_output=True, timeout=60, text=True)
    return json.loads(done.stdout)


def meshes() -> dict[str, tuple[SegmentMesh, dict[str, bool]]]:
    full = lattice_mesh(0, 0)
    bare = replace(full, colours=None, region_ids=None, attributes={})
    wide = replace(full, positions=full.positions * np.float32(1000))
    return {
        "full": (full, {}),
        "bare": (bare, {}),
        "unlit": (full, {"unlit": True}),
        "wide": (wide, {}),
        "jpeg": (textured(full, pillow("JPEG")), {}),
        "png": (textured(full, pillow("PNG")), {}),
        "webp": (textured(wide, pillow("WEBP")), {}),
    }


def test_khronos_validator_reports_no_error(node_folder: Path, tmp_path: Path) -> None:
    paths = []
    for name, (mesh, options) in meshes().items():
        path = tmp_path / f"{name}.glb"
        path.write_bytes(encode_glb(mesh, step_m=STEP_M, attribute_scales=SCALES, **options))
        paths.append(path)
    reports = run_node(node_folder, "validate.mjs", VALIDATE, *paths)
    assert isinstance(reports, list)
    errors = {
        path.stem: [m for m in report["messages"] if m["severity"] < 2]  # errors and warnings
        for path, report in zip(paths, reports, strict=True)
    }
    assert errors == {path.stem: [] for path in paths}


def test_validator_would_find_an_error(node_folder: Path, tmp_path: Path) -> None:
    """The test above can fail: an attribute that glTF does not know."""
    data = encode_glb(lattice_mesh(0, 0), step_m=STEP_M, attribute_scales=SCALES)
    path = tmp_path / "wrong.glb"
    path.write_bytes(data.replace(b'"POSITION":', b'"POSITIVE":'))
    (report,) = run_node(node_folder, "validate.mjs", VALIDATE, path)  # type: ignore[misc]
    assert report["numErrors"] > 0


@pytest.mark.parametrize("name", ["full", "wide"])
def test_javascript_decoder_reads_the_same(node_folder: Path, tmp_path: Path, name: str) -> None:
    """What browsers decode is what our own decoder decodes."""
    mesh, options = meshes()[name]
    data = encode_glb(mesh, step_m=STEP_M, attribute_scales=SCALES, **options)
    path = tmp_path / "mesh.glb"
    path.write_bytes(data)
    answer = run_node(node_folder, "decode.mjs", DECODE, path)
    assert isinstance(answer, dict)
    document, views = answer["document"], [bytes.fromhex(view) for view in answer["views"]]
    primitive = document["meshes"][0]["primitives"][0]
    ours = read_glb(data)
    indices = np.frombuffer(views[primitive["indices"]], dtype="<u2")
    assert np.array_equal(indices.reshape(-1, 3), ours.faces)
    raw = views[primitive["attributes"]["POSITION"]]
    if name == "wide":
        positions = np.frombuffer(raw, dtype="<f4").reshape(-1, 3)
    else:
        node = document["nodes"][0]
        codes = np.frombuffer(raw, dtype="<u2").reshape(-1, 4)[:, :3]
        positions = np.array(node["translation"]) + np.array(node["scale"]) * codes
    assert np.array_equal(positions.astype(np.float32), ours.positions)
    normals = np.frombuffer(views[primitive["attributes"]["NORMAL"]], dtype="<i1").reshape(-1, 4)
    unit = normals[:, :3] / np.linalg.norm(normals[:, :3], axis=1, keepdims=True)
    assert np.allclose(unit, ours.normals, atol=1e-6)
    regions = np.frombuffer(views[primitive["attributes"]["_FEATURE_ID_0"]], dtype="<u2")[::2]
    assert np.array_equal(regions, ours.region_ids)
