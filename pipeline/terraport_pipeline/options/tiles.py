"""Options of tiles: how large they are, and what works on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from terraport_pipeline.option import Option, check_options

__all__ = ["TileOptions"]


@dataclass(frozen=True, slots=True)
class TileOptions:
    """How large tiles are, and who works on them."""

    depth: Annotated[
        int | None,
        Option(flags=("--tile-depth",), least=7, most=12, unset="what --max-memory allows"),
    ] = None
    """Octree depth of a tile: 10 is about 1.1 million faces, 9 a quarter of that."""
    cluster: Annotated[str | None, Option(unset="processes of this machine")] = None
    """Address of a Dask scheduler whose workers solve the tiles: tcp://host:8786. They must see the
    same paths."""

    def __post_init__(self) -> None:
        check_options(self)
