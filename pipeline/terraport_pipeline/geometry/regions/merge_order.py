"""The order in which the graph engine merges: the cost of a merge, and what decides between equals.

A *unit* is a piece of surface with an area A and a perimeter P, the summed weight B of its borders
with other units, all held as whole numbers, so that every sum is exact and none depends on its
order. The cost of a merge is the change of the summed normalised cut (Golovinskiy and Funkhouser):

``d = (P_i + P_j - 2 B_ij) / (A_i + A_j) - (P_i / A_i + P_j / A_j)``.

The order is strict: lower cost; of equal costs the lower *scramble* of the two units' names (their
lowest faces), a fixed one-to-one mix of the two numbers. Equal costs are common (flat ground on a
grid), and "lowest name first" would make chains in which only one pair per round is mutual.

PURE: no I/O, no clock.

References
----------
A. Golovinskiy, T. Funkhouser, "Randomized cuts for 3D mesh analysis", ACM Transactions on Graphics
27(5), 2008, section 4.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["merge_cost", "scramble"]


@numba.njit(cache=True, inline="always")
def merge_cost(p_i: int, a_i: int, p_j: int, a_j: int, border: int) -> float:
    """Cost d of a merge; the same to the last bit when i and j change places."""
    return (p_i + p_j - 2 * border) / (a_i + a_j) - (p_i / a_i + p_j / a_j)


@numba.njit(cache=True, inline="always")
def scramble(a: int, b: int) -> np.uint64:
    """Mix two names, in either order, into 64 bits (the finaliser of splitmix64: one to one)."""
    x = (np.uint64(min(a, b)) << np.uint64(32)) | np.uint64(max(a, b))
    x ^= x >> np.uint64(30)
    x *= np.uint64(0xBF58476D1CE4E5B9)
    x ^= x >> np.uint64(27)
    x *= np.uint64(0x94D049BB133111EB)
    x ^= x >> np.uint64(31)
    return x
