"""How fast the engine clients' cores decode, beside the Python SDK, on the same payloads.

    python benchmarks/engine_decoders.py [SCENE ...] [--segments 200] [--seconds 3] [--smoke]
        [--before REVISION]

Each scene's payloads, evenly spread over it, one thread, into buffers that are used again. Prints
one row per decoder. Without SCENE the payloads are made from a formula. Allocations: of C++ by
every call of `operator new`, of C# by `GC.GetAllocatedBytesForCurrentThread`; the first two rounds,
in which buffers grow, do not count. Python's figures are of `decode_segment`, which makes new
arrays each time. With `--before`, the payload package of a Git revision decodes too, in turn with
today's so that other work on the machine slows down both, and every array that either makes is
compared, byte for byte.

Needs what tests/engines needs (mono-mcs, g++, cmake); says so where they are missing.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import io
import json
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from engines import cores, unreal
from engines.unity import Unity
from engines.unreal import CoreTool, Unreal
from server.grid_scene import SCALES, tile_mesh

from terraport_payload import AttributeScale, decode_segment, encode_segment
from terraport_pipeline.geometry.segments.strip_order import strip_order
from terraport_store import Scene

SEED: Final = 20261122
ROOT: Final = Path(__file__).resolve().parents[1]
TURN_S: Final = 0.05
"""How long one decoder goes on before the other's turn."""

Decoder = Callable[..., Any]
"""A ``decode_segment``."""


@dataclasses.dataclass(frozen=True)
class Source:
    """Payloads of one scene."""

    payloads: Sequence[bytes]
    scales: Mapping[str, AttributeScale]

    def faces(self) -> int:
        """Count the faces of all."""
        meshes = (decode_segment(payload, scales=None) for payload in self.payloads)
        return sum(len(mesh.faces) for mesh in meshes)


def main() -> int:
    parser = argparse.ArgumentParser(description="decode speed of the engine clients")
    parser.add_argument("scenes", nargs="*", type=Path)
    parser.add_argument("--segments", type=int, default=200, help="payloads of each scene")
    parser.add_argument("--seconds", type=float, default=3.0, help="of each measurement")
    parser.add_argument(
        "--before", metavar="REVISION", help="compare with Python's of this revision"
    )
    parser.add_argument("--smoke", action="store_true", help="small and quick")
    options = parser.parse_args()
    clients: list[Unity | Unreal] = []
    if (lacking := cores.missing_for("csharp")) is None:
        clients.append(Unity(cores.csharp()))
    else:
        print(f"csharp: left out ({lacking})")
    if (lacking := unreal.missing()) is None:
        clients.append(unreal.unreal())
    else:
        print(f"cpp: left out ({lacking})")
    seconds = 0.2 if options.smoke else options.seconds
    sources = [(path.name, scene_source(path, options.segments)) for path in options.scenes]
    decoders: dict[str, Decoder] = {"python": decode_segment}
    with tempfile.TemporaryDirectory() as folder:
        if options.before is not None:
            decoders["python before"] = decoder_of(options.before, Path(folder))
        for name, source in sources or [("formula", formula_source(6 if options.smoke else 40))]:
            measure(name, source, clients, decoders, seconds)
    return 0


def decoder_of(revision: str, folder: Path) -> Decoder:
    """Load the payload package of a Git revision beside today's, under another name."""
    command = ["git", "archive", revision, "payload/terraport_payload"]
    archive = subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout
    package = folder / "payload_before"
    package.mkdir()
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        for member in files.getmembers():
            file = files.extractfile(member)
            if file is not None:
                source = file.read().decode().replace("terraport_payload", package.name)
                (package / Path(member.name).name).write_text(source)
    sys.path.insert(0, str(folder))
    before: Decoder = importlib.import_module(f"{package.name}.segment_format").decode_segment
    return before


def scene_source(path: Path, count: int) -> Source:
    """Return payloads of segments spread evenly over a scene."""
    with Scene.open(path) as scene:
        chosen = np.unique(np.linspace(0, len(scene.index) - 1, count).astype(int))
        payloads = [bytes(scene.payload(int(segment))) for segment in chosen]
        return Source(payloads, scene.manifest.scales)


def formula_source(count: int) -> Source:
    """Return wavy squares of 5,000 triangles with noise of a centimetre."""
    draw = np.random.default_rng(SEED)
    payloads = []
    for number in range(count):
        mesh = tile_mesh(number // 6, number % 6, 50, seed=number)
        noise = draw.normal(scale=0.01, size=mesh.positions.shape).astype(np.float32)
        mesh.positions[:] = np.round((mesh.positions + noise) * 512) / 512
        faces = mesh.faces[strip_order(mesh.faces)]
        ordered = dataclasses.replace(mesh, faces=faces)
        payloads.append(encode_segment(ordered, step_m=2.0**-9, scales=SCALES))
    return Source(payloads, SCALES)


def measure(
    name: str,
    source: Source,
    clients: Sequence[Unity | Unreal],
    decoders: dict[str, Decoder],
    seconds: float,
) -> None:
    """Print the rows of one source."""
    payloads = source.payloads
    faces = source.faces() / len(payloads)
    print(f"\n{name}: {len(payloads)} payloads, {faces:,.0f} triangles each on average")
    print(
        f"{'':22}{'KB':>8}{'segments/s':>12}{'MB/s':>9}{'Mtri/s':>8}{'bytes allocated/segment':>25}"
    )
    size_kb = sum(map(len, payloads)) / len(payloads) / 1000
    for client in clients:
        if isinstance(client, Unity):
            row("csharp", size_kb, by_unity(client, source, seconds))
        else:
            row("cpp", size_kb, by_unreal(client, source, seconds))
    for label, figures in by_python(decoders, source, seconds).items():
        row(label, size_kb, figures)


def by_unity(unity: Unity, source: Source, seconds: float) -> dict[str, Any]:
    """Decode and pack with the Unity package's own program; returns what it printed."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{number}.tsg" for number in range(len(source.payloads))]
        for path, payload in zip(paths, source.payloads, strict=True):
            path.write_bytes(payload)
        done = unity.run("decode", seconds, len(source.scales), *paths)
    if done.returncode != 0:
        raise subprocess.SubprocessError(done.stdout[-2000:])
    figures: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return figures


def by_unreal(built: Unreal, source: Source, seconds: float) -> dict[str, Any]:
    """Decode with the core of the Unreal plugin, compiled as for tests."""
    with tempfile.TemporaryDirectory() as folder, CoreTool(built) as tool:
        path = Path(folder) / "payloads"
        path.write_bytes(b"".join(source.payloads))
        figures: dict[str, Any] = tool.ask(f"speed {path} {len(source.scales)} {seconds}")
    return figures


def by_python(
    decoders: dict[str, Decoder], source: Source, seconds: float
) -> dict[str, dict[str, Any]]:
    """Decode with Python's functions, a few payloads by each in turn; counts CPU time alone.

    Wall time would count what else the machine does, and not in equal shares.
    """
    payloads, scales = source.payloads, source.scales
    contents = [
        [content(decode(payload, scales=scales)) for payload in payloads]
        for decode in decoders.values()
    ]
    if any(other != contents[0] for other in contents[1:]):
        raise SystemExit("decoders differ in what they return")
    faces = source.faces()
    spent_s = dict.fromkeys(decoders, 0.0)
    decoded = dict.fromkeys(decoders, 0)
    while min(spent_s.values()) < seconds:
        for label, decode in decoders.items():
            start = time.process_time()
            while time.process_time() - start < TURN_S or decoded[label] % len(payloads):
                decode(payloads[decoded[label] % len(payloads)], scales=scales)
                decoded[label] += 1
            spent_s[label] += time.process_time() - start
    return {
        label: {
            "segments_per_s": decoded[label] / spent_s[label],
            "payload_mb_per_s": rounds * sum(map(len, payloads)) / 1e6 / spent_s[label],
            "mtriangles_per_s": rounds * faces / 1e6 / spent_s[label],
        }
        for label, rounds in ((label, decoded[label] / len(payloads)) for label in decoders)
    }


def content(mesh: Any) -> list[object]:
    """Return all that a decoded mesh holds, so that it can be compared to the bit."""
    values = [getattr(mesh, field.name) for field in dataclasses.fields(mesh)]
    arrays = [*values, *mesh.attributes.values()]
    return [
        list(mesh.attributes),
        [
            (array.dtype.str, array.shape, array.tobytes())
            for array in arrays
            if hasattr(array, "dtype")
        ],
        None if mesh.texture is None else mesh.texture.data,
    ]


def row(name: str, size_kb: float, figures: dict[str, Any]) -> None:
    allocated = figures.get("allocated_bytes_per_segment")
    shown = "" if allocated is None else f"{allocated:,.2f}"
    print(
        f"{name:22}{size_kb:>8.1f}{figures['segments_per_s']:>12,.0f}{figures['payload_mb_per_s']:>9,.0f}"
        f"{figures['mtriangles_per_s']:>8.1f}{shown:>25}"
    )


if __name__ == "__main__":
    sys.exit(main())
