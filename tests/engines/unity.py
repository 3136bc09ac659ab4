"""Run the programs of the Unity package's core, and read what they print."""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from engines.cores import CsCore

from terraport_payload import SegmentMesh

__all__ = ["Unity", "Visit", "digests"]

TIMEOUT_S: Final = 120


@dataclass(frozen=True)
class Visit:
    """What ``land`` printed: see ``client_sdk/unity/Tools~/Visit.cs``."""

    told: dict[str, Any]
    output: str

    @property
    def failure(self) -> str | None:
        """Why it ended early."""
        failure: str | None = self.told["failure"]
        return failure

    def of(self, kind: str) -> list[dict[str, Any]]:
        """Return the events of one type."""
        return [event for event in self.told["events"] if event["type"] == kind]

    @property
    def shown(self) -> list[list[int]]:
        """Segments of each landing that was shown, of all of it."""
        whole = [one for one in self.of("shown") if one["landing"] and not one["degraded"]]
        return [one["segments"] for one in whole]

    @property
    def states(self) -> list[str]:
        """States of the connection."""
        return [one["state"] for one in self.of("link")]

    def __getitem__(self, name: str) -> Any:
        return self.told[name]


@dataclass(frozen=True)
class Unity:
    """The core and its programs, compiled."""

    core: CsCore

    def run(self, *arguments: object) -> subprocess.CompletedProcess[str]:
        """Run a program to its end, whatever its exit code."""
        return subprocess.run(
            [*self.core.program, *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=TIMEOUT_S,
            check=False,
        )

    def corpus(self, kind: str, folder: Path) -> tuple[int, int, str]:
        """Run a corpus; return how many cases passed and failed, and the output."""
        output = self.run("corpus", kind, folder).stdout
        summary = re.search(r"^(\d+) passed, (\d+) failed$", output, re.MULTILINE)
        assert summary, output[-4000:]
        return int(summary[1]), int(summary[2]), output

    def land(self, scene_url: str, *steps: str, **options: object) -> Visit:
        """Visit a scene with ``NAME=value`` options as flags ``--name value``."""
        flags: list[object] = []
        for name, value in options.items():
            flags += [f"--{name.replace('_', '-')}", value]
        done = self.run("land", "--scene", scene_url, *flags, *steps)
        try:
            told = json.loads(done.stdout.strip().splitlines()[-1])
        except (IndexError, ValueError):
            raise AssertionError(f"no JSON from land:\n{done.stdout[-4000:]}") from None
        assert (done.returncode == 0) == (told["failure"] is None), done.stdout[-4000:]
        assert not told.get("faults"), told["faults"]
        return Visit(told, done.stdout)


def digests(mesh: SegmentMesh) -> dict[str, Any]:
    """Return what ``land`` prints for a segment, for a mesh that the SDK decoded."""
    texture = mesh.texture
    return {
        "vertices": len(mesh.positions),
        "faces": len(mesh.faces),
        "positions": _digest(mesh.positions, "<f4"),
        "indices": _digest(mesh.faces, "<u4"),
        "colours": _digest(mesh.colours, "u1"),
        "region_ids": _digest(mesh.region_ids, "<u2"),
        "uvs": _digest(mesh.uvs, "<f4"),
        "image": None if texture is None else hashlib.sha256(texture.data).hexdigest(),
        "media_type": None if texture is None else texture.media_type,
        "attributes": {name: _digest(values, "<f4") for name, values in mesh.attributes.items()},
    }


def _digest(values: Any, dtype: str) -> str | None:
    if values is None:
        return None
    plain = np.ascontiguousarray(values, dtype=dtype)
    if dtype == "<f4":
        plain = np.where(np.isnan(plain), np.float32(np.nan), plain)  # one bit pattern of many
    return hashlib.sha256(plain.tobytes()).hexdigest()
