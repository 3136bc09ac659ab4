"""A worker process as its supervisor sees it: started, spoken with, heard of or not."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, Final

from pydantic import SecretStr

from terraport_server.control import Channel
from terraport_server.listeners import Listeners
from terraport_server.mailbox import Mailbox, Parcel, mailbox_pair
from terraport_server.settings import Settings

__all__ = ["TICK_S", "WorkerProcess"]

TICK_S: Final = 0.1
"""How often silence is looked at; a worker says that it is alive twice as rarely."""

_SILENT_TICKS: Final = 7
"""After 0.7 s without a word others take a worker's new clients: well above what planning and a
busy machine take, and with a client's own round trips below 1.5 s. A false alarm costs nothing:
both accept."""


class WorkerProcess:
    """A worker process. Its tasks end with it.

    Silence is counted in looks, not in time: where the supervisor itself stood still (a machine
    asleep, a container paused), nobody looks dead afterwards.
    """

    def __init__(
        self,
        slot: int,
        process: asyncio.subprocess.Process,
        channel: Channel,
        mailbox: Mailbox | None = None,
    ) -> None:
        self.slot = slot
        self.process = process
        self.channel = channel
        self.mailbox = mailbox
        self.began_s = time.monotonic()
        self.ready = asyncio.Event()
        self.ended = asyncio.Event()
        self.is_expected_to_end = False
        self.page = ""
        """Its metrics as last heard."""
        self.measured = asyncio.Event()
        self.heard_out = asyncio.Event()
        """Its last word was read."""
        self.listens_to: tuple[int, ...] = (slot,)
        """Slots whose new clients it was told to accept."""
        self._silent_ticks = 0

    @classmethod
    async def launch(
        cls,
        slot: int,
        settings: Settings,
        listeners: Listeners,
        pass_on: Callable[[Parcel], None],
    ) -> WorkerProcess:
        """Start a process; it is not ready yet.

        Parameters
        ----------
        slot
            Which worker it is.
        settings, listeners
            What it gets: over a pair of sockets, and by inheritance of all of them.
        pass_on
            Takes connections of groups that it accepted, and owns them.
        """
        ours, theirs = socket.socketpair()
        numbers = [
            [listener.fileno() for listener in listeners.of(number)]
            for number in range(settings.workers)
        ]
        inherited = {number for of_slot in numbers for number in of_slot}
        our_mail: socket.socket | None = None
        mail_number: int | None = None
        with contextlib.ExitStack() as stack:
            stack.enter_context(theirs)
            if settings.groups_served != "none":
                our_mail, their_mail = mailbox_pair()
                mail_number = stack.enter_context(their_mail).fileno()
                inherited.add(mail_number)
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "terraport_server.worker",
                str(theirs.fileno()),
                stdin=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(), *inherited),
                start_new_session=True,  # Ctrl-C is the supervisor's alone to hear
            )
        channel = await Channel.open(ours)
        plain = _as_plain(settings)
        channel.say("start", settings=plain, slot=slot, listeners=numbers, mailbox=mail_number)
        mailbox = None if our_mail is None else Mailbox(our_mail, pass_on)
        return cls(slot, process, channel, mailbox)

    @property
    def is_silent(self) -> bool:
        """Whether nothing was heard of it for too long: it hangs, or is stopped."""
        return self._silent_ticks >= _SILENT_TICKS

    @property
    def silent_s(self) -> float:
        """How long nothing was heard of it, as far as anybody looked."""
        return self._silent_ticks * TICK_S

    def heard(self) -> bool:
        """Note a word of it; tell whether it was silent before."""
        was_silent, self._silent_ticks = self.is_silent, 0
        return was_silent

    def tick(self) -> None:
        """Note that a while went by."""
        self._silent_ticks += 1

    def listen(self, slots: tuple[int, ...]) -> None:
        """Tell it whose new clients to accept, where that has changed."""
        if slots != self.listens_to:
            self.listens_to = slots
            self.channel.say("listen", slots=slots)

    def kill(self) -> None:
        """Kill the process; nothing where it has ended."""
        with contextlib.suppress(ProcessLookupError):
            self.process.kill()


def _as_plain(settings: Settings) -> dict[str, Any]:
    """Every setting as JSON has it, secrets included: for the worker's pair of sockets alone."""
    plain: dict[str, Any] = settings.model_dump(mode="json")
    for name in type(settings).model_fields:
        value = getattr(settings, name)
        if isinstance(value, SecretStr):
            plain[name] = value.get_secret_value()
    return plain
