"""How many threads the kernels use."""

from __future__ import annotations

import numba

__all__ = ["limit_threads"]


def limit_threads(threads: int) -> int:
    """Let parallel kernels use this many threads from now on.

    Parameters
    ----------
    threads : int
        As many as were asked for.

    Returns
    -------
    int
        As many as are used: at least one, and at most what numba was started with
        (``NUMBA_NUM_THREADS``, usually the machine's cores), which it cannot go beyond.
    """
    # numba sets its configuration while it is loaded, so type checkers do not see it
    started_with = int(vars(numba.config)["NUMBA_NUM_THREADS"])
    used = max(1, min(threads, started_with))
    numba.set_num_threads(used)
    return used
