"""Run the tools of a core, and read what they print."""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from engines.cores import CppCore
from sdk.proxy import Proxy

__all__ = ["Client", "Landed", "ThreadedProxy", "Totals", "socket_pace", "totals"]

TIMEOUT_S: Final = 120


@dataclass(frozen=True)
class Totals:
    """The line ``N passed, N failed`` with all that was printed before it."""

    passed: int
    failed: int
    declined: list[str]
    output: str


@dataclass(frozen=True)
class Landed:
    """The JSON that a client's ``land`` program printed last, and its exit code."""

    exit_code: int
    events: list[dict[str, Any]]
    landings: list[dict[str, Any]]
    picks: list[dict[str, Any]]
    segments: dict[int, dict[str, Any]]
    """Of what was held at the end: digests of the decoded arrays."""
    stats: dict[str, Any]
    stage: dict[str, Any]
    """What would be drawn, where the visit was staged (``staged=1``)."""
    failure: str | None
    """Why it ended early."""
    output: str = field(repr=False, default="")

    def of(self, kind: str) -> list[dict[str, Any]]:
        """Return the events of one type."""
        return [event for event in self.events if event["type"] == kind]


@dataclass(frozen=True)
class Client:
    """One core: its language, and its tools."""

    language: str
    core: CppCore

    def run(
        self, tool: str, *arguments: object, timeout_s: float = TIMEOUT_S
    ) -> subprocess.CompletedProcess[str]:
        """Run a tool to its end, whatever its exit code."""
        return subprocess.run(
            [*self.core.tool(tool), *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=timeout_s,
            check=False,
        )

    def corpus(self, kind: str, folder: Path) -> Totals:
        """Run a corpus: ``wire``, ``payload`` or ``session``."""
        return totals(self.run("corpus", kind, folder).stdout)

    def land(self, scene_url: str, *steps: str, **options: object) -> Landed:
        """Land with ``NAME=value`` options as flags ``--name value``; see README.md for steps."""
        flags: list[object] = []
        for name, value in options.items():
            flags += [f"--{name.replace('_', '-')}", value]
        done = self.run("land", "--scene", scene_url, *flags, *steps)
        lines = done.stdout.strip().splitlines()
        try:
            answer = json.loads(lines[-1])
        except (IndexError, ValueError):
            raise AssertionError(f"no JSON from land:\n{done.stdout[-4000:]}") from None
        return Landed(
            done.returncode,
            answer["events"],
            answer["landings"],
            answer["picks"],
            {int(key): value for key, value in answer["segments"].items()},
            answer["stats"],
            answer["stage"] or {},
            answer["failure"],
            done.stdout,
        )


def socket_pace(
    cpp: CppCore,
    scene_url: str,
    radius_m: float,
    *,
    late: bool = False,
    buffer_bytes: int = 32 * 1024,
) -> dict[str, Any]:
    """Land in Unreal's scene on the stubs; return what it took of the socket until it was ready.

    Parameters
    ----------
    late
        Something has loaded the engine's WebSockets module before the plugin starts.
    buffer_bytes
        What one round of the module's thread takes from its socket at most.

    Returns
    -------
    dict
        ``frame_time_s`` (between two rounds of the socket's thread), ``frames`` of 5 ms and
        ``rounds`` until the landing was ready, ``payload_bytes``, ``warnings`` of the plugin's
        start. Time is frames: how fast this machine is does not count.

    Raises
    ------
    RuntimeError
        The visit failed, or found something that is not as it must be.
    """
    program = [str(cpp.folder / "bin" / "terraport-scene-on-stubs")]
    done = subprocess.run(
        [*program, scene_url, str(radius_m), "", "late" if late else "early", str(buffer_bytes)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(done.stdout[-4000:])
    pace: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])["socket"]
    return pace


def totals(output: str) -> Totals:
    """Read the last ``N passed, N failed`` of some output, and the lines of what was declined."""
    summaries = re.findall(r"^(\d+) passed, (\d+) failed$", output, re.MULTILINE)
    assert summaries, f"no line 'N passed, N failed' in:\n{output[-4000:]}"
    declined = re.findall(r"^declined: (\S+)", output, re.MULTILINE)
    return Totals(int(summaries[-1][0]), int(summaries[-1][1]), declined, output)


class ThreadedProxy:
    """`sdk.proxy.Proxy` on a thread of its own, for clients that are programs."""

    def __init__(self, target: str) -> None:
        self.proxy = Proxy(target)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)

    @property
    def url(self) -> str:
        return self.proxy.url

    def cut(self) -> None:
        """Cut every connection now."""
        self._call(self.proxy.cut)

    def __enter__(self) -> Self:
        self._thread.start()
        self._call(self.proxy.__aenter__)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._call(lambda: self.proxy.__aexit__(None, None, None))
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _call(self, work: Callable[[], Any]) -> None:
        asyncio.run_coroutine_threadsafe(work(), self._loop).result(30)
