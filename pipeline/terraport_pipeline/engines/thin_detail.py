"""Reduce a large surface far: in blocks side by side, then as a whole, its border too.

Rejected: one pass over everything (2.1 GB and a larger error from 5 M faces); holding the border as
it is (a survey's border and holes alone are 15,000 to 35,000 edges); clustering vertices on a grid
(linear, but it joins sheets that lie near each other).
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Int32
from terraport_pipeline.errors import EngineError
from terraport_pipeline.geometry.cover.skirt import add_skirt, drop_skirt
from terraport_pipeline.geometry.mesh.face_blocks import block_meshes, face_blocks, weld
from terraport_pipeline.geometry.mesh.trim import compact

__all__ = ["thin_block", "thin_detail"]

_FIRST_AGGRESSION: Final = 7.0
"""Of the first pass, whose result is thinned again: 5 took half as long again and gave the same
final error."""

_FIRST_SHARE: Final = 4
"""The first pass leaves this many times the faces that are wanted. Two passes gave a smaller error
than one from 5 M faces down to 200 k (99.9th percentile 0.33 m against 0.41 m)."""

_LAST_AGGRESSION: Final = 5.0
"""Of the last pass; see :mod:`~terraport_pipeline.engines.decimate`."""

_BLOCK_FACES: Final = 600_000
"""Faces of one block of the first pass: about 250 MB in its process."""

_SKIRT_EDGES: Final = 2.0
"""Length of the skirt in median edges; its planes count, not its length."""


def thin_detail(
    vertices: Float32, faces: Int32, *, max_faces: int, threads: int = 1
) -> tuple[Float32, Int32]:
    """Reduce a large surface far, thinning its border too.

    (1) Blocks of the ground are reduced side by side, each in a process of its own, their borders
    held; (2) the blocks are joined again, bit for bit; (3) the whole is reduced to what is wanted,
    with a skirt on its border (:mod:`~terraport_pipeline.geometry.cover.skirt`), in a child too, so
    that the caller's other threads go on.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
        Wound consistently.
    max_faces : int
        Wanted, about.
    threads : int
        Processes of step 1; the result does not depend on it.

    Returns
    -------
    vertices : ndarray of shape (V', 3), float32
    faces : ndarray of shape (F', 3), int32

    Raises
    ------
    EngineError
        A child process failed.

    Notes
    -----
    Memory: about 60 bytes per face, 250 MB per child, and 500 bytes per face of ``4 max_faces``.
    """
    if len(faces) <= max_faces:
        return vertices, faces
    if len(faces) > 2 * _FIRST_SHARE * max_faces:
        vertices, faces = _thin_blocks(vertices, faces, _FIRST_SHARE * max_faces, threads)
    corners = vertices[faces[:: max(1, len(faces) // 10_000)]].astype(np.float64)
    edge_m = float(np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)))
    hung_vertices, hung_faces, hem = add_skirt(vertices, faces, drop_m=_SKIRT_EDGES * edge_m)
    # Each edge of the hem keeps a face, and so does each edge of the thinned border that it hangs
    # from: 1.6 to 1.7 faces per edge of the hem on surveys (measured).
    wanted = max_faces + len(hem) * 5 // 3
    thinned, triangles = _in_child(hung_vertices, hung_faces, wanted, _LAST_AGGRESSION)
    kept = drop_skirt(thinned, triangles, hem)
    return compact(thinned, kept, np.ones(len(kept), dtype=bool))


def thin_block(
    vertices: Float32, faces: Int32, *, max_faces: int, threads: int = 1
) -> tuple[Float32, Int32]:
    """Reduce a piece of a surface to about `max_faces`, holding its border bit for bit.

    The first pass of :func:`thin_detail`, for a surface that comes in pieces (tiles).
    """
    if len(faces) <= max_faces:
        return vertices, faces
    return _thin_blocks(vertices, faces, max_faces, threads)


def _thin_blocks(
    vertices: Float32, faces: Int32, wanted: int, threads: int
) -> tuple[Float32, Int32]:
    blocks = face_blocks(vertices, faces, max_faces=_BLOCK_FACES)
    share = wanted / len(faces)

    def thin(mesh: tuple[Float32, Int32]) -> tuple[Float32, Int32]:
        return _in_child(*mesh, max(1, int(len(mesh[1]) * share)), _FIRST_AGGRESSION)

    with ThreadPoolExecutor(max(1, threads)) as pool:
        pieces = list(pool.map(thin, block_meshes(vertices, faces, blocks)))
    first = np.cumsum([0, *(len(points) for points, _ in pieces)])
    numbered = [piece[1] + np.int32(base) for piece, base in zip(pieces, first[:-1], strict=True)]
    return weld(np.concatenate([points for points, _ in pieces]), np.concatenate(numbered))


def _in_child(
    vertices: Float32, faces: Int32, max_faces: int, aggression: float
) -> tuple[Float32, Int32]:
    """Decimate in another process: the library works for one caller at a time, under the lock."""
    if len(faces) <= max_faces:
        return vertices, faces
    sent = io.BytesIO()
    np.save(sent, vertices)
    np.save(sent, faces)
    module = "terraport_pipeline.engines.decimate_child"
    numbers = [str(max_faces), repr(aggression), str(os.getpid())]
    done = subprocess.run(
        [sys.executable, "-m", module, *numbers],
        input=sent.getbuffer(),
        capture_output=True,
        check=False,
    )
    if done.returncode:
        output = done.stderr[-2000:].decode("utf-8", "replace").strip()
        raise EngineError(
            f"decimation of {len(faces)} faces ended with exit code {done.returncode}; it printed: "
            f"{output or 'nothing'}"
        )
    received = io.BytesIO(done.stdout)
    points = np.load(received, allow_pickle=False)
    triangles = np.load(received, allow_pickle=False)
    return points.astype(np.float32, copy=False), triangles.astype(np.int32, copy=False)
