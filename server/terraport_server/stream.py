"""The WebSocket endpoint: who may come in, and what is logged and counted of a session."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets

from starlette.websockets import WebSocket, WebSocketDisconnect

from terraport_server.actions import Authorise, Observer
from terraport_server.auth import bearer_token, origin_is_allowed
from terraport_server.errors import AccessError, UnknownSceneError
from terraport_server.logs import log
from terraport_server.scenes import ServedScene
from terraport_server.sender import Sender
from terraport_server.service import Service
from terraport_server.session import INTERNAL_TEXT, Session
from terraport_wire import (
    CLOSE_CODES,
    CloseCode,
    Error,
    ErrorCode,
    Plan,
    Ready,
    Reject,
    Subprotocol,
    Superseded,
    choose_subprotocol,
    encode,
    token_from_subprotocols,
)

__all__ = ["stream"]


class _Chronicle(Observer):
    """Writes what happens to one session into metrics and log, each landing under its id."""

    def __init__(
        self, service: Service, session_id: str, served: ServedScene, client_ip: str
    ) -> None:
        self._service = service
        self._metrics = service.metrics
        self._session_id = session_id
        self._desk = served.desk
        self._scene_id = served.id
        self._client_ip = client_ip

    def planned(self, generation: int, plan: Plan) -> None:
        self._metrics.landings.labels(self._scene_id).inc()
        log(
            "landing planned",
            level=logging.DEBUG,
            landing=self._landing(generation),
            load=len(plan.load),
            keep=len(plan.keep),
            bytes=plan.load_bytes,
            omitted=plan.omitted_segments or None,
        )

    def first_byte(self, seconds: float) -> None:
        self._metrics.first_byte_s.observe(seconds)

    def ready(self, message: Ready, seconds: float) -> None:
        self._metrics.ready_s.observe(seconds)
        log(
            "landing ready",
            landing=self._landing(message.generation),
            scene=self._scene_id,
            seconds=seconds,
            segments=message.delivered,
            bytes=message.payload_bytes,
            missing=len(message.missing) or None,
        )

    def superseded(self, message: Superseded, *, landing: bool) -> None:
        kind = "land" if landing else "aim"
        self._metrics.superseded.labels(kind).inc()
        self._metrics.superseded_bytes.labels(kind).inc(message.unsent_bytes)
        log(
            "superseded",
            level=logging.DEBUG,
            landing=self._landing(message.generation),
            kind=kind,
            unsent_bytes=message.unsent_bytes,
        )

    def rejected(self, message: Reject) -> None:
        self._desk.distrust(message.segment)
        self._metrics.rejected_segments.inc()
        log(
            "segment_rejected",
            level=logging.WARNING,
            landing=self._landing(message.generation),
            scene=self._scene_id,
            segment=message.segment,
            reason=message.reason,
        )

    def refused(self, error: Error) -> None:
        _note_refusal(
            self._service, ErrorCode(error.code), error.message, self._client_ip, self._session_id
        )

    def _landing(self, generation: int) -> str:
        return f"{self._session_id}-{generation}"


async def stream(websocket: WebSocket, scene_id: str, service: Service) -> None:
    """Serve one client from handshake to close."""
    offered = list(websocket.scope["subprotocols"])
    subprotocol = choose_subprotocol(offered)
    await websocket.accept(subprotocol.value if subprotocol is not None else None)
    client_ip = websocket.client.host if websocket.client is not None else "unknown"
    if subprotocol is None:
        service.metrics.errors.labels(ErrorCode.UNSUPPORTED_VERSION).inc()
        names = ", ".join(protocol.value for protocol in Subprotocol)
        await websocket.close(int(CloseCode.VERSION), f"offered: {names}")
        return
    with contextlib.suppress(WebSocketDisconnect):
        refusal = _refusal(websocket, scene_id, offered, service)
        if refusal is None:
            text = service.admit(client_ip)
            if text is None:
                try:
                    await _serve(websocket, subprotocol, scene_id, offered, client_ip, service)
                finally:
                    service.dismiss(client_ip)
                return
            refusal = (ErrorCode.TOO_MANY, text)
        _note_refusal(service, refusal[0], refusal[1], client_ip, None)
        await _refuse(websocket, subprotocol, *refusal)


async def _serve(
    websocket: WebSocket,
    subprotocol: Subprotocol,
    scene_id: str,
    offered: list[str],
    client_ip: str,
    service: Service,
) -> None:
    served = service.registry.get(scene_id)
    session_id = secrets.token_hex(6)
    authorise: Authorise | None = None
    if _given_token(websocket, offered) is None:

        def authorise(token: str | None) -> ErrorCode | None:
            return service.gate.check(token, scene_id)

    session = Session(
        served.view,
        service.session_limits,
        session_id=session_id,
        now_s=asyncio.get_running_loop().time(),
        authorise=authorise,
        observer=_Chronicle(service, session_id, served, client_ip),
    )
    sender = Sender(
        websocket,
        subprotocol,
        session,
        served,
        limits=service.sender_limits,
        metrics=service.metrics,
        priorities=service.priorities,
        run_pick=service.run_pick,
    )
    service.add(sender, served)
    log("session opened", session=session_id, scene=scene_id, client=client_ip)
    try:
        await sender.run()
    except Exception:
        service.metrics.errors.labels(ErrorCode.INTERNAL).inc()
        log("session failed", level=logging.ERROR, session=session_id, scene=scene_id)
        logging.getLogger("terraport.server").exception("session failed")
        await _refuse(websocket, subprotocol, ErrorCode.INTERNAL, INTERNAL_TEXT)
    finally:
        service.remove(sender)
        log("session closed", session=session_id, scene=scene_id)


def _refusal(
    websocket: WebSocket, scene_id: str, offered: list[str], service: Service
) -> tuple[ErrorCode, str] | None:
    """Return why a client may not come in, by what its handshake says."""
    if service.draining or not service.ready:
        return ErrorCode.DRAINING, "got a new session while the server goes away, expected none"
    headers = websocket.headers
    allowed = service.settings.allowed_origins
    if not origin_is_allowed(headers.get("origin"), headers.get("host"), allowed):
        text = f"got origin {headers.get('origin', '')[:200]!r}, expected one that is allowed"
        return ErrorCode.FORBIDDEN, text
    token = _given_token(websocket, offered)
    if token is not None:
        code = service.gate.check(token, scene_id)
        if code is not None:
            return code, str(AccessError(code))
    try:
        service.registry.get(scene_id)
    except UnknownSceneError as error:
        return error.code, str(error)
    return None


def _given_token(websocket: WebSocket, offered: list[str]) -> str | None:
    """Return the handshake's token; ``""`` where there is one that cannot be read."""
    token = bearer_token(websocket.headers.get("authorization"))
    if token is not None:
        return token
    if any(entry.startswith("terraport.token.") for entry in offered):
        return token_from_subprotocols(offered) or ""
    return None


async def _refuse(
    websocket: WebSocket, subprotocol: Subprotocol, code: ErrorCode, text: str
) -> None:
    error = encode(Error(code=code, message=text[:1024], fatal=True), subprotocol)
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # gone, or closed already
        if isinstance(error, str):
            await websocket.send_text(error)
        else:
            await websocket.send_bytes(error)
        await websocket.close(int(CLOSE_CODES[code]), code)


def _note_refusal(
    service: Service, code: ErrorCode, text: str, client_ip: str, session_id: str | None
) -> None:
    """Count a refusal; log the first of its kind per client and minute."""
    service.metrics.errors.labels(code).inc()
    if service.once.first((client_ip, code), asyncio.get_running_loop().time()):
        log(
            "refused",
            level=logging.WARNING,
            code=code,
            reason=text,
            client=client_ip,
            session=session_id,
        )
