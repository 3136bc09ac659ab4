from __future__ import annotations

import numpy as np
import pytest

from terraport_payload.steady import steady_codes


@pytest.mark.parametrize("count", [0, 1, 2, 7, 100])
def test_each_code_is_the_one_before_clamped(count: int) -> None:
    rng = np.random.default_rng(count)
    least = rng.integers(-20, 20, (2, count))
    most = least + rng.integers(0, 15, (2, count))
    codes = steady_codes(least, most)
    for row in range(2):
        code = least[row, 0] if count else 0
        for column in range(count):
            code = min(max(code, least[row, column]), most[row, column])
            assert codes[row, column] == code


def test_bounds_stay_as_they_were() -> None:
    least, most = np.array([0, 5, 0], dtype=np.int8), np.array([9, 9, 2], dtype=np.int8)
    codes = steady_codes(least, most)
    assert codes.tolist() == [0, 5, 2]
    assert codes.dtype == np.int8
    assert least.tolist() == [0, 5, 0]
    assert most.tolist() == [9, 9, 2]
