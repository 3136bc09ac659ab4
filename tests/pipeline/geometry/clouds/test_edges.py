from __future__ import annotations

from dataclasses import replace

import numpy as np

from terraport_pipeline.geometry.clouds.edges import EdgeRule, edge_field, trim_edges


def ribbon(ratio_along: list[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cells in a row along x; both vertices of a step have the ratio given."""
    count = len(ratio_along)
    x = np.repeat(np.arange(count), 2)
    vertices = np.stack([x, 0 * x, np.tile([0, 1], count)], axis=1).astype(np.float32)
    cell = 2 * np.arange(count - 1)
    faces = np.concatenate(
        [np.stack([cell, cell + 1, cell + 2], axis=1), np.stack([cell + 2, cell + 1, cell + 3], 1)]
    )
    return vertices, faces.astype(np.int32), np.repeat(ratio_along, 2).astype(np.float32)


RULE = EdgeRule(threshold=2.0, largest=4.0, spacing_m=1.0, footprint=None)


def test_a_border_is_cut_at_the_threshold_and_a_gap_between_samples_stays() -> None:
    # sampled, a gap that nowhere passes 4, sampled, and the way out
    vertices, faces, ratio = ribbon([1, 1, 3, 3, 1, 1, 3, 5, 7])
    cut, rest = trim_edges(vertices, faces, ratio, RULE)
    assert cut[:, 0].max() == 5.5  # ratio 2 between the steps of 1 and 3
    assert len(rest) >= 12  # nothing is missing before it
    field = edge_field(vertices, faces, ratio, RULE)
    assert (field[4:8] > 0).all()
    assert (field[12:] < 0).all()


def test_a_hem_reaches_farther_by_its_length() -> None:
    vertices, faces, ratio = ribbon([1, 1, 3, 5, 7, 9])
    wide, _ = trim_edges(vertices, faces, ratio, replace(RULE, outward_m=2.0))
    assert wide[:, 0].max() == 2.5  # ratio 4: two spacings beyond the threshold
