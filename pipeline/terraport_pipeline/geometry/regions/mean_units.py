"""Units of faces that are united by mean colour, and the rounds that unite them.

The rule and its reasons stand in ``mean_colour.py``; this is the machine under it. It knows nothing
of meshes, so that units of several tiles are united as well as faces of one mesh
(``tiled_means.py``).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Bool, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.unit_rows import contract_rows, row_sums
from terraport_pipeline.geometry.regions.merge_order import scramble

__all__ = ["MeanUnits", "join_choices", "unite"]

_Rows = tuple[Int64, Int32, Int64]

_THIN_EDGES: Final = 2
"""A unit is thin when it has fewer faces than this many times its perimeter in mean edges: a strip
one square wide has two faces and two border edges a square, hence one face per edge; a strip of
two squares has two."""


@dataclass(frozen=True, slots=True, eq=False)
class MeanUnits:
    """Units of a surface: labels of the faces, and sums, sizes and neighbours of the units."""

    labels: Int32
    """(F,) unit of every face."""
    rows: _Rows
    """Neighbours of every unit, and the length of the border, in steps."""
    sums: Int64
    """(U, C) summed colours, in steps."""
    faces: Int64
    """(U,) number of faces."""
    name: Int32
    """(U,) lowest face."""
    outer: Int64 | None = None
    """(U,) border with what is not among the units (faces of other tiles), in steps; None: none."""


def unite(
    units: MeanUnits,
    weight: Float64,
    limit: float,
    least: int,
    leak: float,
    mean_step: int,
    *,
    threads: int = 1,
) -> MeanUnits:
    """Do rounds until none unites anything; with a mean step only what is small or thin.

    Parameters
    ----------
    units : MeanUnits
    weight : ndarray of shape (C,), float64
        Weight of each colour per step.
    limit : float
        Differences at it or above unite nothing.
    least : int
        Units with fewer faces are small.
    leak : float
        Power of (perimeter / common border).
    mean_step : int
        Mean edge in steps: only small units and those less than two edges wide choose; 0: all do.
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    MeanUnits

    The pair of least difference always chooses each other, so every round makes progress; star
    joins keep the number of rounds near the logarithm of the units.
    """
    while True:
        offsets, _, border = units.rows
        perimeter = row_sums(offsets, border)
        if units.outer is not None:
            perimeter += units.outer
        small = units.faces < least
        if mean_step:
            small |= units.faces * mean_step < _THIN_EDGES * perimeter
        nodes, count = _round(
            units, perimeter, small, weight, limit, least, leak, mean_step > 0, threads
        )
        if count == len(nodes):
            return units
        sums, faces, name = _united(nodes, count, units.sums, units.faces, units.name)
        rows = contract_rows(*units.rows, nodes, count)
        outer = None
        if units.outer is not None:
            outer = np.zeros(count, np.int64)
            np.add.at(outer, nodes, units.outer)
        units = MeanUnits(nodes[units.labels], rows, sums, faces, name, outer)


def _round(
    units: MeanUnits,
    perimeter: Int64,
    small: Bool,
    weight: Float64,
    limit: float,
    least: int,
    leak: float,
    small_only: bool,
    threads: int,
) -> tuple[Int32, int]:
    """Union of every unit after one round, numbered by lowest unit, and their count."""
    choice = np.full(len(perimeter), -1, np.int32)
    in_chunks(
        lambda begin, end: _choose(
            *units.rows, perimeter, units.sums, units.faces, units.name, small,
            weight, limit, least, leak, small_only, choice, begin, end,
        ),
        len(choice), threads=threads,
    )  # fmt: skip
    nodes, count = join_choices(choice, units.faces)
    return nodes, int(count)


@numba.njit(cache=True, nogil=True)
def _choose(
    offsets: Int64,
    neighbours: Int32,
    border: Int64,
    perimeter: Int64,
    sums: Int64,
    faces: Int64,
    name: Int32,
    small: Bool,
    weight: Float64,
    limit: float,
    least: int,
    leak: float,
    small_only: bool,
    choice: Int32,
    begin: int,
    end: int,
) -> None:
    """Choose a neighbour for some units; -1 stays where none is near enough.

    Parameters
    ----------
    offsets, neighbours, border : ndarray
        Neighbours of every unit as CSR, with the length of the border in steps.
    perimeter, sums, faces, name : ndarray of shape (U,), (U, C), (U,), (U,)
        Of every unit: border in all, summed colours, number of faces, lowest face.
    small : ndarray of shape (U,), bool
        Units that are too small to stay.
    weight : ndarray of shape (C,), float64
        Weights of the colour's components.
    limit : float
        Largest distance of two means.
    least : int
        Faces below which a unit is brought nearer.
    leak : float
        Exponent against short borders; 0 leaves it out.
    small_only : bool
        Whether only small units unite, by colour alone.
    choice : ndarray of shape (U,), int32
        Written in begin..end.
    begin, end : int
        Units.
    """
    for u in range(begin, end):
        # Invariant: `choice[u]` is the neighbour of least squared distance so far, or -1. Ties
        # fall to the scrambled names, not to the order of neighbours, so that flat areas do not
        # grow as stripes.
        best = limit * limit
        for e in range(offsets[u], offsets[u + 1]):
            v = neighbours[e]
            # (1) At the end only pairs of which one is too small.
            if small_only and not small[u] and not small[v]:
                continue
            # (2) Weighted squared distance of the mean colours.
            d = 0.0
            for c in range(sums.shape[1]):
                step = (sums[u, c] / faces[u] - sums[v, c] / faces[v]) * weight[c]
                d += step * step
            # (3) Small units are brought nearer, long thin contacts pushed apart.
            if not small_only:
                smaller = min(faces[u], faces[v])
                if smaller < least:
                    d *= smaller / least
                if d > best:  # the power below is at least 1, and takes most of the time
                    continue
                if leak > 0.0:
                    d *= (min(perimeter[u], perimeter[v]) / border[e]) ** (2.0 * leak)
            if d < best or (
                d == best
                and (
                    choice[u] < 0 or scramble(name[u], name[v]) < scramble(name[u], name[choice[u]])
                )
            ):
                best = d
                choice[u] = v


@numba.njit(cache=True, nogil=True)
def join_choices(choice: Int32, size: Int64 | Float64) -> tuple[Int32, int]:
    """Unite units that chose each other, and stars with their middles.

    Parameters
    ----------
    choice : ndarray of shape (U,), int32
        Unit that every unit would join; -1 for none.
    size : ndarray of shape (U,)
        A unit joins a larger one that chose another where that has four times its size.

    Returns
    -------
    node : ndarray of shape (U,), int32
        Union of every unit, numbered by first unit.
    count : int
    """
    count = len(choice)
    # (1) A unit whose choice is at least four times as large, and chose another, may join it all
    # the same: else large ones would grow by one neighbour a round.
    star = np.zeros(count, np.bool_)
    for u in range(count):
        v = choice[u]
        star[u] = v >= 0 and choice[v] != u and size[v] >= 4 * size[u]
    # (2) Who joins whom. Invariant: a mutual pair hangs on its lower unit, a star on a unit that is
    # none, so a root is two steps away at most.
    parent = np.arange(count).astype(np.int32)
    for u in range(count):
        v = choice[u]
        if v >= 0 and ((choice[v] == u and v < u) or (star[u] and not star[v])):
            parent[u] = v
    nodes = np.full(count, -1, np.int32)
    n_unions = 0
    for u in range(count):
        root = u
        while parent[root] != root:
            root = parent[root]
        if nodes[root] < 0:
            nodes[root] = n_unions
            n_unions += 1
        nodes[u] = nodes[root]
    return nodes, n_unions


@numba.njit(cache=True, nogil=True)
def _united(
    nodes: Int32, count: int, sums: Int64, faces: Int64, name: Int32
) -> tuple[Int64, Int64, Int32]:
    """Sum colours and faces over every union, and find its lowest face."""
    new_sums = np.zeros((count, sums.shape[1]), np.int64)
    new_faces = np.zeros(count, np.int64)
    new_name = np.full(count, np.iinfo(np.int32).max, np.int32)
    for u in range(len(nodes)):
        n = nodes[u]
        new_faces[n] += faces[u]
        new_name[n] = min(new_name[n], name[u])
        for c in range(sums.shape[1]):
            new_sums[n, c] += sums[u, c]
    return new_sums, new_faces, new_name
