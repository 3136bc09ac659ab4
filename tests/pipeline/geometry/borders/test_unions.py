"""Units united: what is summed over their contacts."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

from terraport_pipeline.geometry.borders.unions import Units


def units_at_random(count: int, contacts: int, seed: int) -> Units:
    """Units with contacts between any two, steps of two features."""
    rng = np.random.default_rng(seed)
    keys = rng.choice(count * (count - 1) // 2, contacts, replace=False)
    low, high = (side[np.sort(keys)] for side in np.triu_indices(count, 1))
    return Units(
        rng.random((count, 3)), rng.random((count, 4)), rng.random((count, 2)),
        np.stack([low, high], axis=1).astype(np.int32), rng.normal(0.0, 1.0, (contacts, 5)),
        np.arange(count, dtype=np.int32),
    )  # fmt: skip


def test_contacts_of_unions_are_summed_in_their_order_to_the_last_bit():
    """The same, contact by contact in plain loops, steps turned where the ends change places."""
    units = units_at_random(60, 700, seed=1)
    node = np.random.default_rng(2).integers(0, 12, 60).astype(np.int32)
    node[:12] = np.arange(12)
    united = units.united(node, 12)
    sums: dict[tuple[int, int], np.ndarray] = {}
    for (a, b), row in zip(units.pairs, units.contact, strict=True):
        first, second = int(node[a]), int(node[b])
        if first == second:
            continue
        turned = np.array([1, 1, 1, -1, -1]) if first > second else np.ones(5)
        ends = (min(first, second), max(first, second))
        sums[ends] = sums.get(ends, np.zeros(5)) + row * turned
    assert_array_equal(united.pairs, sorted(sums))
    assert_array_equal(united.contact, [sums[ends] for ends in sorted(sums)])


def test_all_united_leaves_no_contact():
    units = units_at_random(9, 20, seed=3)
    one = units.united(np.zeros(9, np.int32), 1)
    assert one.pairs.shape == (0, 2)
    assert one.contact.shape == (0, 5)
    assert one.count == 1
