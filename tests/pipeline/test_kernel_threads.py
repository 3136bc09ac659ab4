"""How many threads the kernels use."""

from __future__ import annotations

import numba
import pytest

from terraport_pipeline.kernel_threads import limit_threads


@pytest.fixture(autouse=True)
def as_before():
    before = numba.get_num_threads()
    yield
    numba.set_num_threads(before)


@pytest.mark.parametrize("requested", [-1, 0, 1])
def test_never_fewer_than_one(requested: int) -> None:
    assert limit_threads(requested) == numba.get_num_threads() == 1


def test_never_more_than_numba_was_started_with() -> None:
    most = limit_threads(10**6)
    assert most == numba.get_num_threads() == numba.config.NUMBA_NUM_THREADS
