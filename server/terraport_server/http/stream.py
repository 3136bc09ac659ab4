"""WebSocket endpoint: checks a handshake, then runs a session."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
from dataclasses import dataclass
from time import monotonic

from starlette.responses import JSONResponse
from starlette.websockets import WebSocket, WebSocketDisconnect

from terraport_server.auth.gate import TokenPass, bearer_token
from terraport_server.auth.origins import host_is_ours, origin_is_allowed
from terraport_server.auth.watch import WatchedSession
from terraport_server.client_key import client_key
from terraport_server.descriptors import NO_DESCRIPTOR, has_free_descriptors
from terraport_server.errors import AccessError, UnknownSceneError
from terraport_server.groups.hub import GroupMember
from terraport_server.logging import log
from terraport_server.service import Service
from terraport_server.session.session import (
    INTERNAL_TEXT,
    UNAUTHORISED_TEXT,
    Session,
    no_hello_text,
)
from terraport_server.stream.connection import REFUSED_CLOSE_S, connection_of
from terraport_server.stream.sender import Sender
from terraport_server.stream.session_log import SessionLog, note_error
from terraport_wire import (
    CLOSE_CODES,
    SUBPROTOCOL,
    CloseCode,
    DecodeError,
    Direction,
    Error,
    ErrorCode,
    Hello,
    Message,
    decode,
    encode,
    token_from_subprotocols,
)

__all__ = ["stream"]


@dataclass(frozen=True, slots=True)
class _Refusal:
    """Refusal of a client: its error, and the label of its metric."""

    code: ErrorCode
    text: str
    reason: str
    """Label of the metric ``refused``; see docs/topics/metrics.md."""


async def stream(websocket: WebSocket, scene_id: str, service: Service) -> None:
    """Serve one client from handshake to close."""
    offered = list(websocket.scope["subprotocols"])
    spoken = SUBPROTOCOL if SUBPROTOCOL in offered else None
    client_ip = websocket.client.host if websocket.client is not None else "unknown"
    connection = connection_of(websocket.scope)
    if not has_free_descriptors():
        service.note_refusal("connections", NO_DESCRIPTOR, client_ip)
        error = {"error": {"code": "connections", "message": NO_DESCRIPTOR}}
        await websocket.send_denial_response(JSONResponse(error, 503))
        return
    await websocket.accept(spoken)
    if spoken is None:
        service.metrics.errors.labels(ErrorCode.UNSUPPORTED_VERSION).inc()
        service.metrics.refused.labels("version").inc()
        connection.close_within(REFUSED_CLOSE_S)
        await websocket.close(int(CloseCode.VERSION), f"offered: {SUBPROTOCOL}")
        return
    with contextlib.suppress(WebSocketDisconnect):
        outcome = _authorise(websocket, scene_id, offered, service)
        if not isinstance(outcome, _Refusal) and (outcome is not None or service.gate.is_open):
            # Clients that authenticate by hello are counted then.
            full = service.session_counts.refusal(client_key(client_ip))
            if full is not None:
                outcome = _Refusal(ErrorCode.TOO_MANY, full[1], full[0])
        if not isinstance(outcome, _Refusal):
            await _serve(websocket, scene_id, outcome, client_ip, service)
            return
        service.metrics.refused.labels(outcome.reason).inc()
        note_error(service.metrics, service.once, outcome.code, outcome.text, client_ip=client_ip)
        await _refuse(websocket, outcome.code, outcome.text)


async def _serve(
    websocket: WebSocket,
    scene_id: str,
    token_pass: TokenPass | None,
    client_ip: str,
    service: Service,
) -> None:
    """Run the session of a client from its first message to its last.

    Invariant: everything registered before ``try`` is released in ``finally``, however the session
    ends; nothing in between awaits.
    """
    try:
        served = service.registry.get(scene_id)
    except UnknownSceneError:  # reported only to clients whose hello has a valid token
        code, text = await _refusal_of_unknown_scene(websocket, scene_id, service)
        service.metrics.refused.labels(str(code)).inc()
        note_error(service.metrics, service.once, code, text, client_ip=client_ip)
        await _refuse(websocket, code, text)
        return
    # Authorised by the token of the handshake, or by that of hello.
    session_id = secrets.token_hex(6)
    connection = connection_of(websocket.scope)
    client = client_key(client_ip)
    is_counted = False

    def authorise(token: str | None) -> tuple[ErrorCode, str] | None:
        nonlocal is_counted
        if token_pass is None:
            admission = service.gate.admit(token, scene_id)
            if isinstance(admission, ErrorCode):
                service.metrics.refused.labels(str(admission)).inc()
                return admission, UNAUTHORISED_TEXT
            watched.token_pass = admission
        # Counted only now: connections without a hello must not use up sessions.
        full = service.session_counts.add(client)
        if full is not None:
            service.metrics.refused.labels(full[0]).inc()
            return ErrorCode.TOO_MANY, full[1]
        is_counted = True
        connection.authenticate()
        name = watched.token_pass.name if watched.token_pass is not None else None
        sender.client = f"{client} {name or ''}"
        session_log.opened()
        return None

    session_log = SessionLog(
        service.metrics, service.once, session_id=session_id, served=served, client_ip=client_ip
    )
    # Observer and groups of the session.
    member: GroupMember | None = None
    if service.groups is not None:

        def may_guide() -> bool:
            token = watched.token_pass
            return service.settings.group_guides == "first" or (token is not None and token.guide)

        def owner() -> tuple[str, str | None]:
            token = watched.token_pass
            return client, None if token is None else token.name

        def deliver(message: Message) -> None:
            session.tell_group(message)
            sender.wake()

        named_by_url = websocket.query_params.get("group")
        member = service.groups.member(
            scene_id, named_by_url, may_guide=may_guide, deliver=deliver, owner=owner
        )
    # The session is pure; the sender carries out its actions.
    session = Session(
        served.view,
        service.session_limits,
        session_id=session_id,
        now_s=monotonic(),
        authorise=authorise,
        observer=session_log,
        groups=member,
    )
    sender = Sender(
        connection,
        session,
        served,
        limits=service.sender_limits,
        metrics=service.metrics,
        scheduler=service.scheduler,
        plans=service.plans,
        run_pick=service.run_pick,
    )

    def withdraw(text: str) -> None:
        session.withdraw(text)
        sender.wake()

    # Register, serve, release.
    watched = WatchedSession(scene_id, withdraw, session_id, token_pass)
    service.add(sender, served)
    connection.on_shutdown = service.begin_drain
    service.access.add(watched)
    try:
        await sender.run()
    except Exception:
        service.metrics.errors.labels(ErrorCode.INTERNAL).inc()
        session_log.ending(ErrorCode.INTERNAL)
        log("session failed", level=logging.ERROR, session=session_id, scene=scene_id)
        logging.getLogger("terraport.server").exception("session failed")
        await _refuse(websocket, ErrorCode.INTERNAL, INTERNAL_TEXT)
    finally:
        if member is not None:
            member.close(monotonic())
        service.access.remove(watched)
        service.remove(sender)
        if is_counted:
            service.session_counts.remove(client)
        session_log.closed()
        # Break the reference cycles with their callbacks, so that no garbage collection is needed.
        session = sender = None  # type: ignore[assignment]


def _authorise(
    websocket: WebSocket, scene_id: str, offered: list[str], service: Service
) -> TokenPass | _Refusal | None:
    """Check a handshake: the rights of its token, a refusal, or ``None`` if ``hello`` decides."""
    if service.draining or not service.ready:
        text = "got a new session while the server shuts down, expected a retry later"
        return _Refusal(ErrorCode.DRAINING, text, "draining")
    headers, settings = websocket.headers, service.settings
    if settings.checks_host and not host_is_ours(headers.get("host"), settings.allowed_hosts):
        text = "got a Host that is not this service's, expected an address or localhost"
        return _Refusal(ErrorCode.FORBIDDEN, text, "host")
    allowed = settings.allowed_origins
    if not origin_is_allowed(headers.get("origin"), headers.get("host"), allowed):
        text = f"got origin {headers.get('origin', '')[:200]!r}, expected one that is allowed"
        return _Refusal(ErrorCode.FORBIDDEN, text, "origin")
    token, token_pass = _given_token(websocket, offered), None
    if token is not None:
        admitted = service.gate.admit(token, scene_id)
        if isinstance(admitted, ErrorCode):
            return _Refusal(admitted, str(AccessError(admitted)), str(admitted))
        token_pass = admitted
    elif not service.gate.is_open:
        # Without a token a client cannot find out whether a scene exists: wait for hello.
        return None
    try:
        service.registry.get(scene_id)
    except UnknownSceneError as error:
        return _Refusal(error.code, str(error), str(error.code))
    return token_pass


async def _refusal_of_unknown_scene(
    websocket: WebSocket, scene_id: str, service: Service
) -> tuple[ErrorCode, str]:
    """Return the error of an unknown scene, without a valid token the same as of a known one."""
    try:
        async with asyncio.timeout(service.session_limits.handshake_timeout_s):
            event = await websocket.receive()
    except TimeoutError:
        return ErrorCode.TIMEOUT, no_hello_text(service.session_limits.handshake_timeout_s)
    if event["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(1006)
    text = event.get("text")
    data: bytes | str = event["bytes"] if text is None else text
    try:
        most_bytes = service.session_limits.max_message_bytes
        message = decode(data, Direction.CLIENT_TO_SERVER, max_bytes=most_bytes)
    except DecodeError as error:
        return error.code, str(error)
    token = message.token if isinstance(message, Hello) else None
    code = service.gate.check(token, scene_id)
    if code is not None:
        return code, UNAUTHORISED_TEXT
    return ErrorCode.UNKNOWN_SCENE, str(UnknownSceneError(scene_id))


def _given_token(websocket: WebSocket, offered: list[str]) -> str | None:
    """Return the token of the handshake; ``""`` if it cannot be decoded, ``None`` without one."""
    token = bearer_token(websocket.headers.get("authorization"))
    if token is not None:
        return token
    if any(entry.startswith("terraport.token.") for entry in offered):
        return token_from_subprotocols(offered) or ""
    return None


async def _refuse(websocket: WebSocket, code: ErrorCode, text: str) -> None:
    error = encode(Error(code=code, message=text[:1024], fatal=True))
    connection_of(websocket.scope).close_within(REFUSED_CLOSE_S)
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # already closed
        await websocket.send_bytes(error)
        await websocket.close(int(CLOSE_CODES[code]), code)
