"""What a page's heap is made of, by V8's heap snapshot."""

from __future__ import annotations

import json
from typing import Any, Final

__all__ = ["object_bytes"]

OBJECTS: Final = frozenset(
    {"object", "array", "string", "concatenated string", "closure", "object shape", "number"}
)
"""Kinds of nodes that scripts make; the others are compiled code, and the browser's own records."""


def object_bytes(cdp: Any) -> int:
    """Return bytes of what the page's scripts keep, without compiled code and browser records.

    Parameters
    ----------
    cdp
        Playwright's session of the DevTools protocol; HeapProfiler must be enabled.
    """
    pieces: list[str] = []

    def took(event: dict[str, str]) -> None:
        pieces.append(event["chunk"])

    cdp.on("HeapProfiler.addHeapSnapshotChunk", took)
    cdp.send("HeapProfiler.takeHeapSnapshot", {"reportProgress": False})
    cdp.remove_listener("HeapProfiler.addHeapSnapshotChunk", took)
    snapshot = json.loads("".join(pieces))
    meta = snapshot["snapshot"]["meta"]
    fields, kinds = meta["node_fields"], meta["node_types"][0]
    kind_at, size_at, stride = fields.index("type"), fields.index("self_size"), len(fields)
    nodes = snapshot["nodes"]
    return sum(
        nodes[at + size_at]
        for at in range(0, len(nodes), stride)
        if kinds[nodes[at + kind_at]] in OBJECTS
    )
