"""One screened Poisson reconstruction in a process of its own.

A process, because the solver is C++ that may exhaust memory or crash, and because one thread per
process gives identical bytes from run to run while two reconstructions still run side by side.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from pathlib import Path
from typing import Final

__all__ = ["die_with_parent", "main"]

_PR_SET_PDEATHSIG: Final = 1
"""Linux `prctl` option: the signal this process gets when its parent dies."""


def main(arguments: list[str]) -> int:
    """Reconstruct.

    Parameters
    ----------
    arguments : list of str
        Input PLY with normals, output PLY, octree depth, point weight, parent's process id.

    Returns
    -------
    int
        Exit code.
    """
    source, target, depth, point_weight, parent = arguments
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the parent, which ends us
    die_with_parent(int(parent))
    import pycolmap

    options = pycolmap.PoissonMeshingOptions()
    options.depth = int(depth)
    options.point_weight = float(point_weight)
    options.num_threads = 1
    options.trim = 0.0
    options.color = False
    # Under its name only when whole: what a stopped child leaves is not taken for a mesh.
    draft = Path(target).with_suffix(".part.ply")
    pycolmap.poisson_meshing(source, str(draft), options)
    if not draft.stat().st_size:
        return 1
    draft.replace(target)
    return 0


def die_with_parent(parent: int) -> None:
    """End this process when its parent ends (Linux)."""
    """End this process when its parent ends, whatever ends it (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it died before the request was made
        os._exit(1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
