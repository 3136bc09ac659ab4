"""Small E57 files node by node: what pye57's own writer cannot say (limits, odd poses, normals)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pye57 import libe57

from terraport_payload.types import AnyArray

_NORMALS = "http://www.libe57.org/E57_NOR_surface_normals.txt"


def write_e57(path: Path, scans: Sequence[Mapping[str, Any]]) -> Path:
    """Write scans.

    Parameters
    ----------
    path : Path
    scans : sequence of mappings
        Each with ``columns`` (by name; whole numbers are written as such), and as wanted
        ``rotation`` (w, x, y, z) and ``translation`` of its pose, of which the last numbers may be
        missing, and structures of numbers by name: ``colorLimits``, ``intensityLimits``.
    """
    file = libe57.ImageFile(str(path), "w")
    root = file.root()
    file.extensionsAdd("", libe57.E57_V1_0_URI)
    file.extensionsAdd("nor", _NORMALS)
    root.set("formatName", libe57.StringNode(file, "ASTM E57 3D Imaging Data File"))
    root.set("guid", libe57.StringNode(file, "{file}"))
    root.set("versionMajor", libe57.IntegerNode(file, 1))
    root.set("versionMinor", libe57.IntegerNode(file, 0))
    every = libe57.VectorNode(file, True)
    root.set("data3D", every)
    for number, scan in enumerate(scans):
        node = libe57.StructureNode(file)
        node.set("guid", libe57.StringNode(file, f"{{scan {number}}}"))
        if "rotation" in scan or "translation" in scan:
            pose = libe57.StructureNode(file)
            for name, axes in (("rotation", "wxyz"), ("translation", "xyz")):
                if name in scan:
                    numbers = dict(zip(axes, scan[name], strict=False))
                    pose.set(name, _numbers(file, numbers))
            node.set("pose", pose)
        for name in ("colorLimits", "intensityLimits"):
            if name in scan:
                node.set(name, _numbers(file, scan[name]))
        every.append(node)
        _write_points(file, node, scan["columns"])
    file.close()
    return path


def colour_limits(low: float, high: float) -> dict[str, float]:
    """One range for all channels."""
    return {
        f"color{channel}{end}": value
        for channel in ("Red", "Green", "Blue")
        for end, value in (("Minimum", low), ("Maximum", high))
    }


def _numbers(file: Any, values: Mapping[str, float]) -> Any:
    node = libe57.StructureNode(file)
    for name, value in values.items():
        node.set(name, libe57.FloatNode(file, float(value)))
    return node


def _write_points(file: Any, node: Any, columns: Mapping[str, AnyArray]) -> None:
    prototype = libe57.StructureNode(file)
    for name, values in columns.items():
        if values.dtype.kind == "f":
            prototype.set(name, libe57.FloatNode(file, 0.0, libe57.E57_DOUBLE))
        else:
            low, high = int(values.min()), max(int(values.max()), int(values.min()) + 1)
            prototype.set(name, libe57.IntegerNode(file, low, low, high))
    points = libe57.CompressedVectorNode(file, prototype, libe57.VectorNode(file, True))
    node.set("points", points)
    held = {name: np.ascontiguousarray(v.astype(np.float64)) for name, v in columns.items()}
    buffers = libe57.VectorSourceDestBuffer()
    count = len(next(iter(held.values())))
    for name, values in held.items():
        buffers.append(libe57.SourceDestBuffer(file, name, values, count, True, True))
    writer = points.writer(buffers)
    writer.write(count)
    writer.close()
