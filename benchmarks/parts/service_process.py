"""``terraport serve`` as a process of its own, and what the system says of it.

Trials talk to the service as its users do: the installed command, settings from the environment, a
real port. Memory is read from ``/proc`` (Linux), summed over the process and its children, so that
a service of several workers counts whole.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

__all__ = ["Memory", "ServiceProcess", "free_port", "listening"]

_COMMAND = "import sys; from terraport.cli import main; sys.exit(main())"
_START_S = 60.0


@dataclass(frozen=True)
class Memory:
    """What the system counts for a process and its children; bytes and numbers."""

    rss: int
    """Resident, whatever it is."""
    anon: int
    """Of it: the process's own (heap, stacks)."""
    file: int
    """Of it: mapped files, among them shared libraries; the page cache of ``read`` and
    ``sendfile`` is no part of it."""
    pss: int
    """Resident, shared pages divided among those who share them."""
    descriptors: int
    threads: int

    def as_dict(self) -> dict[str, int]:
        """Every figure by name, as it goes into the JSON of a result."""
        return asdict(self)


class ServiceProcess:
    """Starts the service and stops it; a context manager.

    Parameters
    ----------
    scenes_dir : Path
        A folder of scenes, or one scene.
    log : Path, optional
        Where standard error goes; nowhere without.
    port : int, optional
        A free one without.
    prefix : sequence of str, optional
        Put before the command: ``("ip", "netns", "exec", NAME)``.
    address : str, optional
        What clients connect to, where that is not this machine's loopback.
    **settings
        Fields of ``terraport_server.Settings``, handed over in the environment.
    """

    def __init__(
        self,
        scenes_dir: Path,
        *,
        log: Path | None = None,
        port: int | None = None,
        prefix: tuple[str, ...] = (),
        address: str = "127.0.0.1",
        **settings: Any,
    ) -> None:
        self.port = free_port() if port is None else port
        self.address = address
        self._prefix = prefix
        self._command = [*prefix, sys.executable, "-c", _COMMAND, "serve", str(scenes_dir)]
        host = str(settings.pop("host", address))
        self._command += ["--host", host, "--port", str(self.port)]
        self._environment = os.environ | {
            f"TERRAPORT_{name.upper()}": str(value) for name, value in settings.items()
        }
        self._log = log
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        """``http://HOST:PORT``."""
        return f"http://{self.address}:{self.port}"

    @property
    def pid(self) -> int:
        """Of the process that was started."""
        assert self._process is not None
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it was started and has not ended since."""
        return self._process is not None and self._process.poll() is None

    def start(self) -> None:
        """Start, and wait until it answers.

        Raises
        ------
        RuntimeError
            When it ends, or is silent for a minute.
        """
        with (self._log or Path(os.devnull)).open("ab") as log:
            self._process = subprocess.Popen(
                self._command, stdout=subprocess.DEVNULL, stderr=log, env=self._environment
            )
        until_s = time.monotonic() + _START_S
        while time.monotonic() < until_s:
            if not self.alive:
                break
            if self._is_listening():
                return
            time.sleep(0.05)
        self.kill()
        raise RuntimeError(f"the service did not start; its log is {self._log}")

    def stop(self) -> int:
        """SIGTERM, and wait; return its exit status."""
        assert self._process is not None
        with suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGTERM)
        try:
            return self._process.wait(60)
        except subprocess.TimeoutExpired:
            self.kill()
            return -9

    def kill(self) -> None:
        """SIGKILL, as the kernel does when memory is short."""
        assert self._process is not None
        self._process.kill()
        self._process.wait()

    def memory(self) -> Memory:
        """Memory, descriptors and threads of the service and its workers now, from /proc."""
        total = dict.fromkeys(("Rss", "RssAnon", "RssFile", "Pss"), 0)
        descriptors = threads = 0
        for pid in self._processes():
            root = Path(f"/proc/{pid}")
            with suppress(FileNotFoundError, ProcessLookupError, PermissionError):
                fields = _fields(root / "smaps_rollup") | _fields(root / "status")
                for name in total:
                    total[name] += fields.get(name, 0)
                descriptors += len(list((root / "fd").iterdir()))
                threads += len(list((root / "task").iterdir()))
        return Memory(
            rss=total["Rss"],
            anon=total["RssAnon"],
            file=total["RssFile"],
            pss=total["Pss"],
            descriptors=descriptors,
            threads=threads,
        )

    def cpu_s(self) -> float:
        """CPU seconds used so far, children included."""
        ticks = 0
        for pid in self._processes():
            with suppress(FileNotFoundError, ProcessLookupError):
                fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
                ticks += int(fields[11]) + int(fields[12])
        return float(ticks / os.sysconf("SC_CLK_TCK"))

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def _is_listening(self) -> bool:
        if self._prefix:  # another network: ask there
            probe = f"import socket; socket.create_connection(({self.address!r}, {self.port}), 1)"
            done = subprocess.run(
                [*self._prefix, sys.executable, "-c", probe], capture_output=True, check=False
            )
            return done.returncode == 0
        try:
            socket.create_connection((self.address, self.port), 1).close()
        except OSError:
            return False
        return True

    def _processes(self) -> list[int]:
        pids, unseen = [], [self.pid]
        while unseen:
            pid = unseen.pop()
            pids.append(pid)
            for task in Path(f"/proc/{pid}/task").glob("*/children"):
                with suppress(FileNotFoundError, ProcessLookupError):
                    unseen += [int(child) for child in task.read_text().split()]
        return pids


def free_port() -> int:
    """Find a port that is free now."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def listening(
    command: list[str], port: int, environment: dict[str, str] | None = None
) -> Iterator[int]:
    """Run a program that serves on a port of this machine, from when it listens; its process.

    Raises
    ------
    RuntimeError
        It ended before, or did not listen in 20 s.
    """
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, env=environment)
    try:
        until_s = time.monotonic() + 20.0
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
                break
            except OSError:
                if process.poll() is not None or time.monotonic() > until_s:
                    raise RuntimeError(f"{command[0]} does not listen on port {port}") from None
                time.sleep(0.05)
        yield process.pid
    finally:
        process.terminate()
        process.wait()


def _fields(path: Path) -> dict[str, int]:
    """Read ``Name: 123 kB`` lines; bytes."""
    bytes_by_field = {}
    for line in path.read_text().splitlines():
        name, _, rest = line.partition(":")
        words = rest.split()
        if len(words) == 2 and words[1] == "kB":
            bytes_by_field[name] = 1024 * int(words[0])
    return bytes_by_field
