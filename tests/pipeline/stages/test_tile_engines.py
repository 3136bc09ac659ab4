"""Engines over tiles: what uniting takes is known before it is done."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.errors import ResourceError
from terraport_pipeline.options.regions import Options
from terraport_pipeline.stages.contract import Stored
from terraport_pipeline.stages.tiles.tile_engines import CELL_BYTES, check_memory

TILES = [Stored({"keys": np.arange(count)}, {}) for count in (300_000, 700_000)]


def test_cells_of_all_tiles_fit_or_are_refused() -> None:
    borders = Options(engine="borders")
    check_memory(TILES, borders, 1_000_000 * CELL_BYTES)
    with pytest.raises(
        ResourceError, match=r"1,000,000 cells .* 0\.79 GiB; allowed are 0\.50 GiB: raise"
    ):
        check_memory(TILES, borders, 2**29)


def test_other_engines_have_no_cells() -> None:
    check_memory([Stored({}, {})], Options(engine="means"), 1)
