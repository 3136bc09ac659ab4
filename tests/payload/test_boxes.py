from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from terraport_payload import box_distances_m

METRES = st.floats(-1e6, 1e6, width=32)


def distance_by_the_specification(box: list[float], centre: tuple[float, ...]) -> float:
    """Compute spec/protocol.md, section 4, in Python's float64, one operation after the other."""
    dx, dy, dz = (max(box[k] - centre[k], 0.0, centre[k] - box[k + 3]) for k in range(3))
    return math.sqrt(dx * dx + dy * dy + dz * dz)


def test_distances_written_out() -> None:
    bounds = np.array(
        [[0, 0, 0, 2, 2, 2], [5, 0, 0, 6, 4, 2], [1, 4, 5, 1, 4, 5], [1, 1, 1, 3, 3, 3]],
        dtype=np.float32,
    )
    assert box_distances_m(bounds, (1.0, 1.0, 1.0)).tolist() == [0.0, 4.0, 5.0, 0.0]


@given(
    hnp.arrays(np.float32, st.tuples(st.integers(0, 20), st.just(6)), elements=METRES),
    st.tuples(*[st.floats(-1e6, 1e6)] * 3),
)
def test_every_bit_is_as_the_specification_has_it(
    corners: np.ndarray, centre: tuple[float, float, float]
) -> None:
    bounds = np.hstack(
        [np.minimum(corners[:, :3], corners[:, 3:]), np.maximum(corners[:, :3], corners[:, 3:])]
    )
    expected = [distance_by_the_specification(box, centre) for box in bounds.tolist()]
    assert box_distances_m(bounds, centre).tolist() == expected
