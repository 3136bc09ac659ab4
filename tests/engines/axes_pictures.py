"""The scene ``axes`` as each client draws it: ``python tests/engines/axes_pictures.py`` writes
``docs/images/engine-axes.png``.

Each core lands on the service, decodes what came, and turns it by its engine layer's own code; then
`engine_view` draws that by the engine's conventions. The first picture is the Python SDK's, which
stays in the scene frame.
"""

from __future__ import annotations

import base64
import json
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

if __name__ == "__main__":  # run as a script: the package "engines" lies in tests/
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from conformance.scene.axes_scene import write_axes_scene
from engines import cores
from engines.engine_view import CONVENTIONS, Drawn, beside, draw
from engines.sdk_arrays import land_with_sdk
from engines.unity import Unity
from engines.unreal import CoreTool, Unreal, unreal
from faults.service import Service

import terraport.sync
from terraport_payload.types import AnyArray

__all__ = ["PICTURE", "drawn_by_sdk", "drawn_by_unity", "drawn_by_unreal"]

PICTURE: Final = cores.ROOT / "docs" / "images" / "engine-axes.png"
LANDING: Final = (0.0, 1.0, -3.0, 60.0)


def drawn_by_sdk(url: str) -> list[Drawn]:
    """Return the landed meshes in the scene frame."""
    _, meshes = land_with_sdk(url, [LANDING])
    return [
        Drawn(
            mesh.positions,
            mesh.normals,
            mesh.faces,
            mesh.colours,
            mesh.uvs,
            None if mesh.texture is None else mesh.texture.data,
        )
        for mesh in meshes.values()
    ]


def drawn_by_unity(unity: Unity, url: str) -> list[Drawn]:
    """Return the meshes of the landing as the Runtime of the Unity package packs them."""
    with tempfile.TemporaryDirectory() as folder, terraport.sync.connect(url) as session:
        segments = session.land(LANDING[:3], LANDING[3]).ready()
        payloads = [Path(folder) / f"{segment.id}.tsg" for segment in segments]
        for path, segment in zip(payloads, segments, strict=True):
            path.write_bytes(segment.payload)
        done = unity.run("axes", *payloads)
    return [_mesh(record) for record in json.loads(done.stdout.strip().splitlines()[-1])]


def drawn_by_unreal(built: Unreal, url: str) -> list[Drawn]:
    """Return the meshes of the landing as Unreal is given them."""
    with tempfile.TemporaryDirectory() as folder, terraport.sync.connect(url) as session:
        paths, drawn = [], []
        for segment in session.land(LANDING[:3], LANDING[3]).ready():
            paths.append(Path(folder) / f"{segment.id}.tsg")
            paths[-1].write_bytes(segment.payload)
        with CoreTool(built) as tool:
            for path in paths:
                told = tool.ask(f"segment {path} 32")
                image = path.read_bytes()[told["image_offset"] :] if told["uvs"] else None
                drawn.append(
                    Drawn(
                        np.array(told["unreal_positions"]).reshape(-1, 3),
                        np.array(told["unreal_normals"]).reshape(-1, 3),
                        np.array(told["faces"]).reshape(-1, 3),
                        _rows(told["colours"] or None, 3),
                        _rows(told["uvs"] or None, 2),
                        image,
                    )
                )
    return drawn


def _mesh(record: dict[str, Any]) -> Drawn:
    image = base64.b64decode(record["image"]) if record["image"] else None
    linear = _rows(record["linear_colours"], 3)
    colours = None
    if linear is not None:
        curved = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        colours = 255 * curved
    uvs = _rows(record["uvs"], 2)
    positions, normals = np.array(record["positions"]), np.array(record["normals"])
    faces = np.array(record["indices"]).reshape(-1, 3)
    return Drawn(positions.reshape(-1, 3), normals.reshape(-1, 3), faces, colours, uvs, image)


def _rows(values: list[float] | None, columns: int) -> AnyArray | None:
    return None if values is None else np.array(values).reshape(-1, columns)


def main() -> int:
    """Let both clients land in the scene of axes and draw what each hands to its engine."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "scenes"
        root.mkdir()
        write_axes_scene(root / "axes")
        with Service(root) as service:
            url = f"{service.url}/scenes/axes"
            pictures = {"Python SDK": draw(drawn_by_sdk(url), CONVENTIONS["scene"])}
            drawn = {
                "unity": drawn_by_unity(Unity(cores.csharp()), url),
                "unreal": drawn_by_unreal(unreal(), url),
            }
            for engine, meshes in drawn.items():
                name = f"{engine.capitalize()}, as its client hands it over"
                pictures[name] = draw(meshes, CONVENTIONS[engine])
    beside(pictures, PICTURE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
