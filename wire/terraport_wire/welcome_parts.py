"""What a server says of itself and of its scene, within `welcome`."""

from __future__ import annotations

import dataclasses
from typing import Annotated

from .kinds import Choice, Integer, Number, Text
from .limits import MAX_HELD_SEGMENTS, MAX_INTEGER, MAX_LEVELS, MAX_PLAN_SEGMENTS, MAX_RADIUS_M
from .message import Part

__all__ = ["PullInfo", "SceneInfo", "ServerLimits"]

_U32 = 2**32 - 1


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SceneInfo(Part):
    """Which scene is served."""

    id: Annotated[str, Text(128, shortest=1), "Id of the scene in URLs"]
    version: Annotated[str, Text(64, shortest=1), "Version; changes whenever any byte does"]
    name: Annotated[str, Text(256), "Name for people"]
    segment_count: Annotated[
        int,
        Integer(0, _U32),
        "Segments of the scene: ids are below it, those of coarser levels above (section 6.1)",
    ]
    levels: Annotated[
        int | None, Integer(1, MAX_LEVELS), "Levels of every segment; absent means 1"
    ] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ServerLimits(Part):
    """What this server allows on this connection."""

    max_radius_m: Annotated[
        float, Number(0.0, MAX_RADIUS_M, low_excluded=True), "Largest radius of aim and land"
    ]
    max_message_bytes: Annotated[int, Integer(1, MAX_INTEGER), "Largest message to the server"]
    max_messages_per_s: Annotated[
        float, Number(0.0, 1e9, low_excluded=True), "Messages per second, averaged over 10 s"
    ]
    max_held_segments: Annotated[int, Integer(0, MAX_HELD_SEGMENTS), "Most segments in hello.held"]
    max_plan_segments: Annotated[
        int, Integer(0, MAX_PLAN_SEGMENTS), "Most segments in a plan, as a budget would cut"
    ]
    max_credit_bytes: Annotated[
        int, Integer(1, MAX_INTEGER), "Most outstanding credit; more is clamped"
    ]
    idle_timeout_s: Annotated[
        float, Number(0.0, 1e9, low_excluded=True), "Silence after which the server closes"
    ]
    groups: Annotated[
        str | None,
        Choice("none", "here", "query"),
        "Whether groups can be joined: `here`; `query`: only where the URL of the stream names "
        "the group; `none`. Absent means `none`",
    ] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PullInfo(Part):
    """Where a client that pulls fetches payload."""

    base: Annotated[
        str,
        Text(2048),
        "Base address, ending in `/`: `http` or `https`, or relative to the server URL",
    ]
    pack: Annotated[
        str,
        Text(201, shortest=1),
        "Path of the pack below the base address; its bytes never change",
    ]
    pack_bytes: Annotated[int, Integer(1, MAX_INTEGER), "Length of the pack"]
