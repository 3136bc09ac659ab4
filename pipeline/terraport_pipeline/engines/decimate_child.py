"""One decimation in a process of its own: mesh on standard input, mesh on standard output.

A process, because the library keeps its mesh in a global: two threads of one process would wait for
each other.
"""

from __future__ import annotations

import io
import sys

import numpy as np

from terraport_pipeline.engines.decimate import decimate
from terraport_pipeline.engines.poisson_child import die_with_parent

__all__ = ["main"]


def main(arguments: list[str]) -> int:
    """Decimate.

    Parameters
    ----------
    arguments : list of str
        Faces wanted, aggression, parent's process id.

    Returns
    -------
    int
        Exit code.
    """
    max_faces, aggression, parent = arguments
    die_with_parent(int(parent))
    received = io.BytesIO(sys.stdin.buffer.read())
    vertices = np.load(received, allow_pickle=False)
    faces = np.load(received, allow_pickle=False)
    points, triangles = decimate(
        vertices, faces, max_faces=int(max_faces), aggression=float(aggression)
    )
    np.save(sys.stdout.buffer, points)
    np.save(sys.stdout.buffer, triangles)
    sys.stdout.buffer.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
