"""What is told of textures that were made tile by tile."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np

from terraport_pipeline.stages.contract import Stored
from terraport_pipeline.stages.tiles.tiled_texture import STEP_BINS
from terraport_pipeline.workflow.workdir import StageRecord

__all__ = ["choice_counts", "step_counts"]

_COUNTED: Final = (
    "faces_seen", "faces_unseen", "faces_borrowed", "rays", "faces_rated", "outliers",
)  # fmt: skip
"""Numbers of the choice of views that add up over tiles."""


def choice_counts(records: Sequence[StageRecord]) -> dict[str, Any]:
    """Add up what the choice of views counted, tile by tile."""
    return {
        f"choice_{name}": sum(int(record.values[name]) for record in records) for name in _COUNTED
    }


def step_counts(tiles: Iterable[Stored]) -> dict[str, Any]:
    """Tell how far colours step across seams, within tiles and across their borders.

    ``choice_seam_share`` is the share of the edges that part two photos.
    """
    listed = [tile.arrays for tile in tiles if "steps_edges" in tile.arrays]
    counts: dict[str, Any] = {}
    if not listed:
        return counts
    edges = sum(np.asarray(arrays["steps_edges"], np.float64) for arrays in listed)
    middles = (np.arange(STEP_BINS) + 0.5) * 48.0 / STEP_BINS
    for row, where in ((0, ""), (1, "_across_tiles")):
        all_edges, seam_edges = (float(value) for value in np.asarray(edges)[row])
        if not all_edges:
            continue
        counts[f"choice_seam_share{where}"] = round(seam_edges / all_edges, 5)
        for name in ("photos", "gains", "smooth", "local"):
            weights = np.sum([arrays[f"steps_{name}"][row] for arrays in listed], axis=0)
            total = float(weights.sum())
            if total:
                mean = float((weights * middles).sum() / total)
                index = int(np.searchsorted(np.cumsum(weights), 0.95 * total))
                counts[f"choice_seam_step_{name}{where}"] = round(mean, 3)
                counts[f"choice_seam_step_p95_{name}{where}"] = float(middles[index])
    return counts
