"""Decoding asks for no memory that grows with a segment; the benchmark's program is run."""

from __future__ import annotations

import json
import struct
from pathlib import Path

from engines.programs import Client
from server.grid_scene import SCALES, STEP_M, tile_mesh

from terraport_payload import encode_segment


def test_nothing_is_allocated_in_the_steady_state(client: Client, tmp_path: Path) -> None:
    attributes = [
        {"name": name, "offset": scale.offset, "step": scale.step} for name, scale in SCALES.items()
    ]
    payloads = [
        encode_segment(tile_mesh(0, n, 20 + 5 * n), step_m=STEP_M, scales=SCALES) for n in range(4)
    ]
    records = [json.dumps(attributes).encode(), *payloads]
    path = tmp_path / "payloads"
    path.write_bytes(b"".join(struct.pack("<I", len(record)) + record for record in records))
    done = client.run("decode", path, "--seconds", 0.5)
    assert done.returncode == 0, done.stdout
    figures = json.loads(done.stdout.strip().splitlines()[-1])
    assert figures["segments"] >= 40
    assert figures["meter_saw_bytes"] > 1000, "a meter that stands still proves nothing"
    assert figures["allocations"] == 0
