"""Write seeds for the fuzz targets from the conformance corpus.

``python seeds.py FOLDER`` makes ``FOLDER/glb``, ``arrays``, ``cover``, ``meshopt``, ``manifest``; give each to its target.
"""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path

CORPUS = Path(__file__).resolve().parents[3] / "tests" / "conformance" / "scene"


def split(glb: bytes) -> tuple[bytes, bytes]:
    """JSON and BIN chunk of a GLB."""
    (length,) = struct.unpack_from("<I", glb, 12)
    return glb[20 : 20 + length], glb[28 + length :]


def streams(glb: bytes) -> list[bytes]:
    """Each compressed buffer as the target ``meshopt`` takes it."""
    text, binary = split(glb)
    found = []
    for view in json.loads(text)["bufferViews"]:
        packed = view.get("extensions", {}).get("EXT_meshopt_compression")
        if packed is None:
            continue
        vertex = packed["mode"] == "ATTRIBUTES"
        kind = packed["byteStride"] // 4 - 1 if vertex else 4
        count = packed["count"] if vertex else packed["count"] // 3
        at = packed.get("byteOffset", 0)
        if count <= 2048:
            head = struct.pack("<BH", kind, count - 1)
            found.append(head + binary[at : at + packed["byteLength"]])
    return found


def main(folder: Path) -> None:
    """Write all of them."""
    kinds = {name: folder / name for name in ("glb", "arrays", "cover", "meshopt", "manifest")}
    for place in kinds.values():
        place.mkdir(parents=True, exist_ok=True)

    def add(kind: str, data: bytes) -> None:
        (kinds[kind] / f"{len(list(kinds[kind].iterdir())):04}").write_bytes(data)

    for path in sorted([*CORPUS.glob("payload/*.glb"), *CORPUS.glob("*/v-*/base.glb")]):
        data = path.read_bytes()
        add("glb", data)
        if path.name.startswith("good") or path.name == "base.glb":
            text, binary = split(data)
            add("glb", struct.pack("<H", len(text)) + text + binary)
            for stream in streams(data):
                add("meshopt", stream)
    for path in sorted(CORPUS.glob("payload/*.arrays")):
        add("arrays", path.read_bytes())
    for path in sorted(CORPUS.glob("*/v-*/base.cover")):
        add("cover", path.read_bytes())
    for path in sorted(CORPUS.glob("*/scene.json")) + sorted(CORPUS.glob("*/v-*/regions.json")):
        add("manifest", path.read_bytes())
    for path in sorted(CORPUS.glob("*/labels.json")):
        add("manifest", path.read_bytes())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
