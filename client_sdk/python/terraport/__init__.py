"""terraport: land in a scene and have its full detail around you.

::

    import terraport

    async with terraport.connect("http://localhost:8080/scenes/quarry", token) as session:
        landing = await session.land((12.0, 3.5, -40.0), radius_m=60)
        for segment in await landing.ready():
            mesh = segment.arrays()

:mod:`terraport.sync` is the same without asyncio. The core install brings all of this; servers,
builds and pictures need the extras ``terraport[server]`` and ``terraport[pipeline]``.
"""

from __future__ import annotations

from terraport import errors, sync
from terraport.base import BaseMesh
from terraport.client import Session, SessionStats, connect
from terraport.errors import LandingSuperseded, TerraportError
from terraport.landing import Landing, LandingStats
from terraport.mesh import mixed_model, to_trimesh, write_glb
from terraport.segment import Segment
from terraport.timeouts import Timeouts
from terraport.version import __version__

__all__ = [
    "BaseMesh",
    "Landing",
    "LandingStats",
    "LandingSuperseded",
    "Segment",
    "Session",
    "SessionStats",
    "TerraportError",
    "Timeouts",
    "__version__",
    "connect",
    "errors",
    "mixed_model",
    "sync",
    "to_trimesh",
    "write_glb",
]
