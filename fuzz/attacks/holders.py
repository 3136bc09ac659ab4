"""Attacks by HTTP with a token, and without one where the service asks for a lot of work.

As in :mod:`attacks.load`, each runs from one address until it is told to stop. What a request costs
depends on the scene: strokes and labels make it larger.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import partial
from typing import Final

from attacks.requests import flood
from attacks.strangers import Attack, Going

__all__ = ["HOLDER_ATTACKS"]

_DRAW: Final = random.Random(20)


def _radius() -> str:
    return f"{_DRAW.uniform(10.0, 400.0):.6f}"


_ASKED: Final[dict[str, Callable[[], list[str]]]] = {
    "lists of scenes": lambda: ["GET /scenes"],
    "manifests": lambda: ["GET /scenes/SCENE"],
    "tilesets": lambda: [f"GET /scenes/SCENE/tileset.json?radius_m={_radius()}" for _ in range(64)],
    "tileset again": lambda: ["GET /scenes/SCENE/tileset.json"],
    "labels": lambda: ["GET /scenes/SCENE/labels.json"],
    "regions": lambda: ["GET /scenes/SCENE/regions.json"],
    "strokes": lambda: ["GET /scenes/SCENE/strokes"],
    "taught": lambda: ["GET /scenes/SCENE/taught"],
    "bases": lambda: ["GET /scenes/SCENE/base.tsg", "GET /scenes/SCENE/base.glb"],
    "metrics": lambda: ["GET /metrics"],
    "readiness": lambda: ["GET /readyz"],
}
"""Lines of the requests of one address."""


def _ask(
    lines: Callable[[], list[str]],
    reads: bool,
    port: int,
    scene: str,
    token: str,
    going: Going,
    address: str,
) -> int:
    """Ask without end on each of many connections."""
    rest = f" HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {token}\r\n\r\n"
    requests = [(line.replace("SCENE", scene) + rest).encode() for line in lines()]
    return flood(port, requests, going, address, reads=reads)


HOLDER_ATTACKS: Final[dict[str, Attack]] = {
    **{name: partial(_ask, lines, True) for name, lines in _ASKED.items()},
    "unread tilesets": partial(_ask, _ASKED["tilesets"], False),
    "unread strokes": partial(_ask, _ASKED["strokes"], False),
}
