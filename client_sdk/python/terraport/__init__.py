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

# Names are imported when they are first used: the command line, which lives in this package too,
# then starts in a third of the time (0.4 s instead of 1.3 s).
from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from terraport import errors, sync
    from terraport.base import BaseMesh
    from terraport.errors import LandingSuperseded, TerraportError
    from terraport.frames import crs_positions
    from terraport.group import Arrivals, Group, GroupLanding
    from terraport.landing import Landing, LandingPlan, LandingStats, Segment
    from terraport.mesh import mixed_model, to_trimesh, write_glb
    from terraport.obj import write_obj
    from terraport.options import Timeouts
    from terraport.places import CoarserPiece, Place
    from terraport.session import Session, SessionStats, connect
    from terraport.textures import decode_texture, vertex_colours
    from terraport.trace import LandingTrace, write_trace
    from terraport.version import __version__

__all__ = [
    "Arrivals",
    "BaseMesh",
    "CoarserPiece",
    "Group",
    "GroupLanding",
    "Landing",
    "LandingPlan",
    "LandingStats",
    "LandingSuperseded",
    "LandingTrace",
    "OutsideSceneWarning",
    "Place",
    "Segment",
    "Session",
    "SessionStats",
    "TerraportError",
    "Timeouts",
    "__version__",
    "connect",
    "crs_positions",
    "decode_texture",
    "errors",
    "mixed_model",
    "sync",
    "to_trimesh",
    "vertex_colours",
    "write_glb",
    "write_obj",
    "write_trace",
]

_HOMES: Final = {
    "Arrivals": "group",
    "BaseMesh": "base",
    "CoarserPiece": "places",
    "Group": "group",
    "GroupLanding": "group",
    "Landing": "landing",
    "LandingPlan": "landing",
    "LandingStats": "landing",
    "LandingSuperseded": "errors",
    "LandingTrace": "trace",
    "OutsideSceneWarning": "errors",
    "Place": "places",
    "Segment": "landing",
    "Session": "session",
    "SessionStats": "session",
    "TerraportError": "errors",
    "Timeouts": "options",
    "__version__": "version",
    "connect": "session",
    "crs_positions": "frames",
    "decode_texture": "textures",
    "mixed_model": "mesh",
    "to_trimesh": "mesh",
    "vertex_colours": "textures",
    "write_glb": "mesh",
    "write_obj": "obj",
    "write_trace": "trace",
}
"""Module of each name; modules themselves stand for themselves."""


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(importlib.import_module(f"terraport.{_HOMES[name]}"), name)
    elif name in __all__:
        value = importlib.import_module(f"terraport.{name}")
    else:
        raise AttributeError(f"module 'terraport' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
