"""Encoded payloads of every tile, read in the order of the scene's segments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

import numpy as np

from terraport_payload.types import AnyArray, UInt64
from terraport_pipeline.stages.contract import Stored
from terraport_pipeline.stages.pack import Payload
from terraport_pipeline.stages.tiles.tiled_join import TiledSegmented

__all__ = ["PayloadFiles", "hashes_of", "payloads_by_number"]


class PayloadFiles(Protocol):
    """Access to the encoded payloads of every tile, in the work directory."""

    def __call__(self, tile: int) -> Stored:
        """Give what :func:`encode` made of one tile; arrays may be mapped."""
        ...


def hashes_of(segmented: TiledSegmented, payloads: PayloadFiles) -> UInt64:
    """Look up the hash of every payload, in order of the segments, (S,)."""
    hashes = np.empty(len(segmented.tile), np.uint64)
    for tile in np.unique(segmented.tile).tolist():
        rows = segmented.tile == tile
        hashes[rows] = payloads(tile).arrays["payload_xxh3"][segmented.within[rows]]
    return hashes


def payloads_by_number(
    segmented: TiledSegmented, payloads: PayloadFiles, level: int = 0
) -> Iterator[Payload]:
    """Read every payload of one level in the order of the scene's segments."""
    tables: dict[int, tuple[Mapping[str, AnyArray], dict[str, AnyArray]]] = {}
    for tile, within in zip(segmented.tile.tolist(), segmented.within.tolist(), strict=True):
        if tile not in tables:
            arrays = payloads(tile).arrays
            small = {name: np.array(arrays[name]) for name in arrays if name != "payload"}
            small["starts"] = np.concatenate([[0], np.cumsum(arrays["payload_length"])])
            small["segments"] = np.array(np.count_nonzero(segmented.tile == tile))
            tables[tile] = arrays, small
        arrays, small = tables[tile]
        row = within + level * int(small["segments"])
        begin, end = small["starts"][row : row + 2]
        coarser = {name: int(small[name][row]) for name in ("region", "region_count") if level}
        yield Payload(
            data=arrays["payload"][begin:end].tobytes(),
            bounds=tuple(small["bounds"][row].tolist()),
            vertices=int(small["vertices"][row]),
            faces=int(small["faces"][row]),
            **coarser,
        )
