"""One of several processes behind one port: ``python -m terraport_server.worker CONTROL_FD``.

Started by the supervisor only, which hands over settings and listening sockets (they would show in
the process list otherwise: settings hold tokens).
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import signal
import socket
import sys
from types import FrameType
from typing import Any

from terraport_server.control import Channel
from terraport_server.doorway import Doorway
from terraport_server.errors import ServerError
from terraport_server.logging import configure_logging, log
from terraport_server.mailbox import Mailbox, Parcel
from terraport_server.serving import TerraportServer, make_server
from terraport_server.settings import Settings

__all__ = ["main"]

_SCRAPE_TIMEOUT_S = 5.0
_ALIVE_PERIOD_S = 0.2
"""A third of what the supervisor takes for silence."""


class _Worker:
    """The worker's end of the control channel, around one server.

    Parameters
    ----------
    server
        Which it says all of this about.
    channel_end
        Of the control channel.
    listeners
        Sockets of all workers, by slot; the server itself accepts from those of `slot`.
    slot
        Which worker this is.
    mail_end
        Connections of groups come and go there; None where groups are not served.
    """

    def __init__(
        self,
        server: TerraportServer,
        channel_end: socket.socket,
        listeners: list[list[socket.socket]],
        slot: int,
        mail_end: socket.socket | None,
    ) -> None:
        self._server = server
        self._end = channel_end
        self._listeners = listeners
        self._slot = slot
        self._mail_end = mail_end
        self._mailbox: Mailbox | None = None
        self._adopted: dict[int, list[Doorway]] = {}
        self._channel: Channel | None = None
        self._scrapes: dict[int, asyncio.Future[bytes]] = {}
        self._asked = 0
        self._hearing: asyncio.Task[None] | None = None
        self._saying: asyncio.Task[None] | None = None
        self._taking: set[asyncio.Task[Any]] = set()
        server.service.all_metrics = self.all_metrics
        server.on_started = self.started
        server.on_ended = self.ended

    async def started(self) -> None:
        """Say that clients are served from now on."""
        self._channel = await Channel.open(self._end)
        self._hearing = asyncio.create_task(self._hear(self._channel))
        groups = self._server.service.groups
        if self._mail_end is not None and groups is not None:
            self._mailbox = Mailbox(self._mail_end, self._take)
            self._server.http_class.pass_on = staticmethod(self._mailbox.send)
            groups.changed = self._say_groups
        self._channel.say("ready")
        self._saying = asyncio.create_task(self._say_alive(self._channel))

    async def ended(self) -> None:
        """Hand over the last counts."""
        if self._channel is None or self._hearing is None or self._saying is None:
            return
        self._hearing.cancel()
        self._saying.cancel()
        if self._mailbox is not None:
            self._mailbox.close()
        self._say_page(self._channel)
        await self._channel.close()

    async def all_metrics(self) -> bytes:
        """Ask the supervisor for the metrics of all workers; our own where it does not answer."""
        if self._channel is None:
            return self._server.service.metrics.render()
        self._asked += 1
        number = self._asked
        answer: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        self._scrapes[number] = answer
        try:
            self._channel.say("scrape", number=number)
            async with asyncio.timeout(_SCRAPE_TIMEOUT_S):
                return await answer
        except TimeoutError:
            return self._server.service.metrics.render()
        finally:
            del self._scrapes[number]

    async def _hear(self, channel: Channel) -> None:
        while (message := await channel.hear()) is not None:
            kind = message["kind"]
            if kind == "measure":
                self._say_page(channel)
            elif kind == "merged":
                answer = self._scrapes.get(message["number"])
                if answer is not None and not answer.done():
                    answer.set_result(message["page"].encode())
            elif kind == "listen":
                self._listen(set(message["slots"]))
            elif kind == "retire":
                self._server.retire()
        self._server.should_exit = True  # the supervisor is gone

    def _listen(self, slots: set[int]) -> None:
        """Accept the new clients of these workers, beside our own, and of no others."""
        for slot in set(self._adopted) - slots:
            for doorway in self._adopted.pop(slot):
                self._server.stop_accepting(doorway)
        for slot in slots - {self._slot} - set(self._adopted):
            self._adopted[slot] = [
                self._server.accept_from(listener.dup()) for listener in self._listeners[slot]
            ]

    def _take(self, parcel: Parcel) -> None:
        """Serve a connection that another worker accepted: its group lives here."""
        task = asyncio.create_task(self._server.take_over(parcel))
        self._taking.add(task)
        task.add_done_callback(self._taking.discard)

    def _say_groups(self, names: frozenset[str]) -> None:
        if self._channel is not None:
            self._channel.say("groups", names=sorted(names))

    async def _say_alive(self, channel: Channel) -> None:
        """Say that the event loop turns, until cancelled."""
        while True:
            channel.say("alive")
            await asyncio.sleep(_ALIVE_PERIOD_S)

    def _say_page(self, channel: Channel) -> None:
        channel.say("page", page=self._server.service.metrics.render().decode())


def _read_start(end: socket.socket) -> dict[str, Any]:
    """Read the first line, before any event loop runs; nothing else is sent before ``ready``."""
    line = b""
    while not line.endswith(b"\n"):
        piece = end.recv(65536)
        if not piece:
            raise ServerError("got no settings from the supervisor, expected them first")
        line += piece
    start: dict[str, Any] = json.loads(line)
    return start


def main(arguments: list[str]) -> int:
    """Serve until told to stop.

    Returns
    -------
    int
        Exit code: 1 when it could not start.
    """
    # uvicorn takes SIGTERM while it serves and raises it again at the end: it ends nothing then.
    signal.signal(signal.SIGTERM, _leave)
    # A hang-up is the supervisor's: it rolls the workers, one by one.
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    end = socket.socket(fileno=int(arguments[0]))
    start = _read_start(end)
    settings = Settings(**start["settings"])
    slot = int(start["slot"])
    configure_logging(settings.log_level, settings.log_format, worker=slot)
    by_number: dict[int, socket.socket] = {}
    listeners = [
        [by_number.setdefault(number, socket.socket(fileno=number)) for number in numbers]
        for numbers in start["listeners"]
    ]
    mail_end = None if start["mailbox"] is None else socket.socket(fileno=start["mailbox"])
    try:
        server = make_server(settings)
    except ServerError as error:
        log("worker cannot serve", level=logging.ERROR, reason=str(error))
        return 1
    server.owns_process = True
    _Worker(server, end, listeners, slot, mail_end)
    with contextlib.suppress(KeyboardInterrupt, SystemExit):
        server.run(sockets=listeners[slot])
    return 0 if server.started else 1


def _leave(_number: int, _frame: FrameType | None) -> None:
    raise SystemExit(0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
