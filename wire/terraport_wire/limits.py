"""Limits that every speaker of the protocol keeps (spec/protocol.md, section 9).

These are the protocol's own bounds: no message beyond them is ever valid, whatever a server is
configured for.  A server may be stricter; what it allows is said in ``welcome.limits``.
"""

from __future__ import annotations

__all__ = [
    "FRAME_HEADER_BYTES",
    "MAX_ATTRIBUTES",
    "MAX_CHUNK_BYTES",
    "MAX_CLIENT_MESSAGE_BYTES",
    "MAX_CLIENT_VALUES",
    "MAX_CONTAINER_ITEMS",
    "MAX_COORDINATE_M",
    "MAX_DEADLINE_MS",
    "MAX_DEPTH",
    "MAX_FRAME_BYTES",
    "MAX_GPU_ELEMENT_BYTES",
    "MAX_GROUP_MEMBERS",
    "MAX_GROUP_NAME",
    "MAX_HAVE",
    "MAX_HEADER_BYTES",
    "MAX_INTEGER",
    "MAX_LEVELS",
    "MAX_PLAN_SEGMENTS",
    "MAX_RADIUS_M",
    "MAX_SEGMENT_BYTES",
    "MAX_SERVER_MESSAGE_BYTES",
    "MAX_TOKEN_BYTES",
    "MAX_WITHOUT",
]

MAX_INTEGER = 2**53 - 1
"""Largest integer in a message: beyond it a JavaScript number is no longer exact."""

MAX_LEVELS = 2
"""Levels of a segment: its detail, and one coarser one."""

MAX_FRAME_BYTES = 128 * 1024
"""Largest payload frame, header included: a supersede takes effect within one frame."""

MAX_GPU_ELEMENT_BYTES = 4096
"""Most bytes that a client may say one vertex, or a triangle's indices, take on its GPU."""

FRAME_HEADER_BYTES = 24
"""Header that a sender writes; a receiver goes by the length in the header."""

MAX_CHUNK_BYTES = MAX_FRAME_BYTES - FRAME_HEADER_BYTES
"""Most payload bytes in one frame."""

MAX_HEADER_BYTES = 1024
"""Largest payload header a receiver accepts: room for later versions' fields."""

MAX_SEGMENT_BYTES = 64 * 1024 * 1024
"""Largest segment: a 2048 x 2048 texture with 20,000 faces stays far below it."""

MAX_CLIENT_MESSAGE_BYTES = 1024 * 1024
"""Largest message from a client: a ``land`` with the most keys takes 33 kB of it."""

MAX_CLIENT_VALUES = 1024
"""Most msgpack values of a message from a client, keys, maps and arrays counted: the longest that
the protocol has takes 33. A server looks at each of them, so bytes alone bound nothing: a megabyte
of one-byte values took it a tenth of a second."""

MAX_SERVER_MESSAGE_BYTES = 8 * 1024 * 1024
"""Largest message from a server: a ``plan`` with the most segments takes half a megabyte of it."""

MAX_HAVE = 4096
"""Most keys in ``have``: 32 KiB."""

MAX_WITHOUT = 64
"""Most keys in ``without``."""

MAX_PLAN_SEGMENTS = 16_384
"""Most segments of one plan."""

MAX_RADIUS_M = 1_000_000.0
"""Largest radius that is a number at all; servers allow far less (``limits.max_radius_m``)."""

MAX_COORDINATE_M = 10_000_000.0
"""Largest coordinate of the scene frame: float32 detail around an origin ends long before."""

MAX_DEADLINE_MS = 600_000
"""Longest deadline of a group landing: ten minutes."""

MAX_TOKEN_BYTES = 4096
"""Longest token: signed tokens with claims fit."""

MAX_ATTRIBUTES = 64
"""Most attributes in a pick's answer."""

MAX_DEPTH = 16
"""Deepest nesting of maps and arrays in a message (known messages need 4)."""

MAX_CONTAINER_ITEMS = 16_384
"""Most items of one msgpack array or map: ids and tables are packed, so few are needed."""

MAX_GROUP_NAME = 64
"""Longest name of a group, and of a member in it: both go into every roster."""

MAX_GROUP_MEMBERS = 1024
"""Most members of one group: a roster of them stays far below `MAX_SERVER_MESSAGE_BYTES`."""
