"""The first exchange of a session: ``hello`` checked, ``welcome`` made.

PURE: no I/O, no clock. spec/wire-protocol.md, section 5.
"""

from __future__ import annotations

from dataclasses import dataclass

from terraport_server.session.actions import Authorise, SceneView, SessionLimits
from terraport_server.session.deliveries import Deliveries
from terraport_wire import PROTOCOL, ErrorCode, Hello, SceneInfo, ServerLimits, Welcome

__all__ = ["UNOPENED_TEXT", "Refusal", "check_hello", "make_welcome", "no_hello_text"]

UNOPENED_TEXT = "got no token that opens this scene, expected one"


def no_hello_text(timeout_s: float) -> str:
    """Return what a client is told that said nothing."""
    return f"got no hello in {timeout_s:g} s, expected it first"


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a ``hello`` is not accepted."""

    code: ErrorCode
    text: str
    protocols: tuple[tuple[int, int], ...] | None = None


def check_hello(
    hello: Hello, scene: SceneView, limits: SessionLimits, authorise: Authorise | None
) -> Refusal | None:
    """Return why a ``hello`` cannot be accepted, ``None`` where it can.

    The token is looked at before anything that would tell a stranger about the scene.
    """
    if hello.protocol[0] != PROTOCOL[0]:
        text = f"got protocol {hello.protocol[0]}.{hello.protocol[1]}, expected {PROTOCOL[0]}.x"
        return Refusal(ErrorCode.UNSUPPORTED_VERSION, text, (PROTOCOL,))
    refused = None if authorise is None else authorise(hello.token)
    if refused is not None:
        return Refusal(*refused)
    if hello.encoding not in scene.encodings:
        offered = ", ".join(sorted(scene.encodings))
        text = f"got encoding {hello.encoding}, expected one of: {offered}"
        return Refusal(ErrorCode.UNSUPPORTED_ENCODING, text)
    rows = 0 if hello.held is None else len(hello.held)
    if rows > limits.max_held_segments:
        text = f"got {rows} held segments, expected at most {limits.max_held_segments}"
        return Refusal(ErrorCode.TOO_LARGE, text)
    return None


def make_welcome(
    hello: Hello, scene: SceneView, limits: SessionLimits, deliveries: Deliveries, session_id: str
) -> Welcome:
    """Return the answer to an accepted ``hello``."""
    rows = 0 if hello.held is None else len(hello.held)
    table = scene.encodings[hello.encoding]
    return Welcome(
        protocol=(PROTOCOL[0], min(hello.protocol[1], PROTOCOL[1])),
        server=limits.server,
        session=session_id,
        scene=SceneInfo(
            id=scene.id,
            version=scene.version,
            name=scene.name,
            segment_count=table.segment_count,
            levels=None if table.levels == 1 else table.levels,
        ),
        limits=ServerLimits(
            max_radius_m=limits.max_radius_m,
            max_message_bytes=limits.max_message_bytes,
            max_messages_per_s=limits.max_messages_per_s,
            max_held_segments=limits.max_held_segments,
            max_plan_segments=limits.max_plan_segments,
            max_credit_bytes=limits.max_credit_bytes,
            idle_timeout_s=limits.idle_timeout_s,
            groups=limits.groups,
        ),
        release_factor=deliveries.release_factor,
        dropped=deliveries.dropped,
        held_count=rows - len(deliveries.dropped),
        pull=None if deliveries.pull is None else deliveries.pull.info,
    )
