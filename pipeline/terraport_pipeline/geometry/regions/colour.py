"""Colour as the Triangle Pool Algorithm sees it: the CIEDE2000 distance to white.

To white the CIEDE2000 formula has a closed form: white has no chroma, so the hue term and the
rotation term vanish and only lightness and chroma remain,

``dE = sqrt((dL / S_L)^2 + (C' / S_C)^2)``.

With this the distance is *blind to hue*: red and green of equal lightness and chroma are equally
far from white (`segmentation.md`, section 1). Faithful to the thesis; said here so that nobody
looks for it elsewhere.

PURE: no I/O, no clock.

References
----------
G. Sharma, W. Wu, E. N. Dalal, "The CIEDE2000 color-difference formula: implementation notes,
supplementary test data, and mathematical observations", Color Research and Application 30(1), 2005.
Symbols as there, k_L = k_C = 1. IEC 61966-2-1:1999 (sRGB), D65 white. Thesis, section 3.5.4.1,
equation (3.1): ``l_i``.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
import numpy.typing as npt

from terraport_payload.types import AnyFloat, AnyInt, Float32, Float64, Int16, Int32, UInt8, UInt16
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = [
    "face_colour_sums",
    "face_lab",
    "srgb_to_lab",
    "white_distance",
    "white_distance_of_sums",
    "white_index",
]


# IEC 61966-2-1 linear RGB -> XYZ, each row divided by its own sum: white is then exactly (1, 1, 1),
# so a* = b* = 0 for every grey to the last bit. (With the rounded D65 white of the tables, grey
# gets a chroma of up to 0.01.)
_TO_XYZ: Final = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
_TO_WHITE_XYZ: Final = _TO_XYZ / _TO_XYZ.sum(axis=1, keepdims=True)
_POW25_7: Final = 25.0**7


def srgb_to_lab(colours: UInt8 | AnyFloat) -> Float64:
    """Convert sRGB to CIELAB (D65).

    Parameters
    ----------
    colours : ndarray of shape (N, 3), uint8 or float
        sRGB, 0..255; fractions allowed in float arrays (means of several colours).

    Returns
    -------
    ndarray of shape (N, 3), float64
        L* 0..100, a*, b*. Greys have a* = b* = 0 to about 1e-13.

    Raises
    ------
    ValueError
        Wrong shape.

    Examples
    --------
    >>> np.round(srgb_to_lab(np.array([[255, 0, 0]], dtype=np.uint8)), 2).tolist()
    [[53.24, 80.09, 67.2]]
    """
    _validate_colours(colours)
    encoded = colours.astype(np.float64) / 255.0
    return _lab(_linear(encoded).reshape(-1, 3))


def white_distance(colours: UInt8 | AnyFloat) -> Float32:
    """CIEDE2000 difference of every colour to white.

    Parameters
    ----------
    colours : ndarray of shape (N, 3), uint8 or float
        sRGB, 0..255.

    Returns
    -------
    ndarray of shape (N,), float32
        0 (white) to 100 (black).

    Raises
    ------
    ValueError
        Wrong shape.

    Examples
    --------
    >>> white_distance(np.array([[255, 255, 255], [0, 0, 0]], dtype=np.uint8)).tolist()
    [0.0, 100.0]
    """
    _validate_colours(colours)
    if colours.dtype == np.uint8:
        return white_distance_of_sums(colours.astype(np.uint16), 1)
    return _white_distance(srgb_to_lab(colours))


def face_colour_sums(colours: UInt8, faces: AnyInt) -> UInt16:
    """Sum of the three vertex colours of every face.

    The sum keeps the mean exact (in thirds) and does not depend on the corners' order, as a float
    mean would.

    Parameters
    ----------
    colours : ndarray of shape (V, 3), uint8
        sRGB.
    faces : ndarray of shape (F, 3), integer
        Vertex indices.

    Returns
    -------
    ndarray of shape (F, 3), uint16
        0..765; divide by 3 for the face colour.
    """
    sums: UInt16 = colours[faces[:, 0]].astype(np.uint16)
    sums += colours[faces[:, 1]]
    sums += colours[faces[:, 2]]
    return sums


def face_lab(colours: UInt8, faces: AnyInt, steps: float) -> Int16:
    """CIELAB colour of every face's mean vertex colour, in whole steps.

    Parameters
    ----------
    colours : ndarray of shape (V, 3), uint8
        sRGB.
    faces : ndarray of shape (F, 3), integer
        Vertex indices.
    steps : float
        Steps per unit of L*, a*, b*; at most 200, so that 16 bits hold them.

    Returns
    -------
    ndarray of shape (F, 3), int16
    """
    return _lab_of_sums(face_colour_sums(colours, faces), _table(3), _TO_WHITE_XYZ, steps)


def white_distance_of_sums(sums: UInt16, summands: int) -> Float32:
    """CIEDE2000 difference to white of colours given as sums of ``summands`` 8-bit colours.

    Parameters
    ----------
    sums : ndarray of shape (N, 3), uint16
        Sums of sRGB values, 0..255 * parts.
    summands : int
        Number of colours in each sum (3 for :func:`face_colour_sums`), 1..257.

    Returns
    -------
    ndarray of shape (N,), float32
        0..100.

    Notes
    -----
    The sRGB curve becomes a table of ``255 * parts + 1`` entries, so a face costs three cube roots
    and no power.
    """
    return _white_distance_of_sums(np.ascontiguousarray(sums), _table(summands), _TO_WHITE_XYZ)


def white_index(colours: UInt8, faces: AnyInt, *, threads: int = 1) -> Float32:
    """CIEDE2000 difference to white of every face's mean vertex colour (3.1).

    Parameters
    ----------
    colours : ndarray of shape (V, 3), uint8
        sRGB.
    faces : ndarray of shape (F, 3), integer
        Vertex indices.
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    ndarray of shape (F,), float32
        What :func:`white_distance_of_sums` makes of :func:`face_colour_sums`, without the sums'
        array in between.
    """
    _validate_colours(colours)
    given, corners = as_kernel_input(colours, np.uint8), as_kernel_input(faces, np.int32)
    table, index = _table(3), np.empty(len(corners), np.float32)
    in_chunks(
        lambda begin, end: _white_index(given, corners, table, _TO_WHITE_XYZ, index, begin, end),
        len(corners), threads=threads,
    )  # fmt: skip
    return index


def _validate_colours(colours: npt.NDArray[np.generic]) -> None:
    if colours.ndim != 2 or colours.shape[1] != 3:
        msg = f"colours have shape {colours.shape}, expected (N, 3)"
        raise ValueError(msg)


def _table(summands: int) -> Float64:
    """Linear light of every possible sum of ``summands`` 8-bit values."""
    return _linear(np.arange(255 * summands + 1, dtype=np.float64) / (255.0 * summands))


def _linear(encoded: Float64) -> Float64:
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def _lab(linear: Float64) -> Float64:
    xyz = linear @ _TO_WHITE_XYZ.T
    f = np.where(xyz > 216.0 / 24389.0, np.cbrt(xyz), (24389.0 / 27.0 * xyz + 16.0) / 116.0)
    return np.stack(
        [116.0 * f[:, 1] - 16.0, 500.0 * (f[:, 0] - f[:, 1]), 200.0 * (f[:, 1] - f[:, 2])], axis=1
    )


@numba.njit(cache=True, nogil=True)
def _to_white(lightness: float, a: float, b: float) -> float:
    """Evaluate CIEDE2000 against (100, 0, 0): C_1 = 0, so dH' = 0 and R_T has no effect."""
    half = 0.5 * np.sqrt(a * a + b * b)
    pow7 = half * half * half
    pow7 = pow7 * pow7 * half
    a_prime = a * (1.5 - 0.5 * np.sqrt(pow7 / (pow7 + _POW25_7)))
    chroma = np.sqrt(a_prime * a_prime + b * b)
    offset = 0.5 * (lightness + 100.0) - 50.0
    s_l = 1.0 + 0.015 * offset * offset / np.sqrt(20.0 + offset * offset)
    s_c = 1.0 + 0.0225 * chroma  # 0.045 times the mean of C' and 0
    d_l = (100.0 - lightness) / s_l
    d_c = chroma / s_c
    distance: float = np.sqrt(d_l * d_l + d_c * d_c)
    return distance


@numba.njit(cache=True, nogil=True)
def _white_distance(lab: Float64) -> Float32:
    distance = np.empty(len(lab), np.float32)
    for i in range(len(lab)):
        distance[i] = _to_white(lab[i, 0], lab[i, 1], lab[i, 2])
    return distance


@numba.njit(cache=True, nogil=True)
def _curve(t: float) -> float:
    if t > 216.0 / 24389.0:
        root: float = np.cbrt(t)
        return root
    return (24389.0 / 27.0 * t + 16.0) / 116.0


@numba.njit(cache=True, nogil=True)
def _of_linear(r: float, g: float, b: float, matrix: Float64) -> float:
    x = _curve(matrix[0, 0] * r + matrix[0, 1] * g + matrix[0, 2] * b)
    y = _curve(matrix[1, 0] * r + matrix[1, 1] * g + matrix[1, 2] * b)
    z = _curve(matrix[2, 0] * r + matrix[2, 1] * g + matrix[2, 2] * b)
    return _to_white(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))


@numba.njit(cache=True, nogil=True)
def _white_distance_of_sums(sums: UInt16, table: Float64, matrix: Float64) -> Float32:
    distance = np.empty(len(sums), np.float32)
    for i in range(len(sums)):
        distance[i] = _of_linear(table[sums[i, 0]], table[sums[i, 1]], table[sums[i, 2]], matrix)
    return distance


@numba.njit(cache=True, nogil=True)
def _white_index(
    colours: UInt8,
    faces: Int32,
    table: Float64,
    matrix: Float64,
    index: Float32,
    begin: int,
    end: int,
) -> None:
    for f in range(begin, end):
        u, v, w = faces[f, 0], faces[f, 1], faces[f, 2]
        r = np.int64(colours[u, 0]) + colours[v, 0] + colours[w, 0]
        g = np.int64(colours[u, 1]) + colours[v, 1] + colours[w, 1]
        b = np.int64(colours[u, 2]) + colours[v, 2] + colours[w, 2]
        index[f] = _of_linear(table[r], table[g], table[b], matrix)


@numba.njit(cache=True, nogil=True)
def _lab_of_sums(sums: UInt16, table: Float64, matrix: Float64, steps: float) -> Int16:
    lab = np.empty((len(sums), 3), np.int16)
    for i in range(len(sums)):
        r, g, b = table[sums[i, 0]], table[sums[i, 1]], table[sums[i, 2]]
        x = _curve(matrix[0, 0] * r + matrix[0, 1] * g + matrix[0, 2] * b)
        y = _curve(matrix[1, 0] * r + matrix[1, 1] * g + matrix[1, 2] * b)
        z = _curve(matrix[2, 0] * r + matrix[2, 1] * g + matrix[2, 2] * b)
        lab[i, 0] = np.int16(np.rint((116.0 * y - 16.0) * steps))
        lab[i, 1] = np.int16(np.rint(500.0 * (x - y) * steps))
        lab[i, 2] = np.int16(np.rint(200.0 * (y - z) * steps))
    return lab
