"""Space-filling curves against bit-by-bit definitions."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.curve import (
    CURVE_BITS,
    hilbert_codes,
    hilbert_order,
    morton_codes,
    morton_order,
)


def lattice(n):
    """All positions of an n x n x n lattice, n a power of two."""
    return (
        np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1)
        .reshape(-1, 3)
        .astype(float)
    )


def test_morton_interleaves_bits():
    """x takes bits 0, 3, 6...; y 1, 4, 7...; z 2, 5, 8..."""
    top = 2**CURVE_BITS - 1
    cells = np.random.default_rng(1).integers(0, top, (50, 3))
    cells[0], cells[1] = 0, top  # the range, so that quantising is the identity
    expected = [
        sum(
            int(c[axis] >> bit & 1) << 3 * bit + axis
            for bit in range(CURVE_BITS)
            for axis in range(3)
        )
        for c in cells
    ]
    assert morton_codes(cells.astype(float)).tolist() == expected


def test_hilbert_visits_neighbours():
    """Along the Hilbert order of a full lattice every step goes to an adjacent cell, as it must."""
    positions = lattice(8)
    steps = np.abs(np.diff(positions[hilbert_order(positions)], axis=0)).sum(axis=1)
    assert steps.tolist() == [1.0] * (8**3 - 1)


def test_codes_are_distinct_and_orders_are_permutations():
    """No two cells of a lattice share a code."""
    positions = lattice(4)
    for codes, order in ((morton_codes, morton_order), (hilbert_codes, hilbert_order)):
        assert len(np.unique(codes(positions))) == 64
        assert sorted(order(positions).tolist()) == list(range(64))


def test_flat_scene_keeps_square_cells():
    """One scale for all axes: a thin scene's height does not fill the code."""
    flat = np.array([[0.0, 0.0, 0.0], [1000.0, 1e-6, 0.0], [0.0, 0.0, 1000.0]])
    assert morton_codes(flat)[1] == morton_codes(flat * [1, 0, 1])[1]


def test_ties_keep_the_given_order():
    """Coinciding positions all get code 0 and stay as they were."""
    same = np.full((5, 3), 7.0)
    assert morton_codes(same).tolist() == hilbert_codes(same).tolist() == [0] * 5
    assert morton_order(same).tolist() == hilbert_order(same).tolist() == [0, 1, 2, 3, 4]
    assert morton_codes(np.zeros((0, 3))).shape == (0,)


def test_bad_positions_are_named():
    """Which one, and what it is."""
    with pytest.raises(ValueError, match=r"position 1 is \[0.0, nan, 0.0\], expected finite"):
        morton_codes(np.array([[0.0, 0, 0], [0, np.nan, 0]]))
    with pytest.raises(ValueError, match=r"shape \(3,\), expected \(N, 3\)"):
        hilbert_codes(np.zeros(3))
