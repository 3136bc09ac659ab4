"""`terraport serve --workers N` as processes, for tests: started, asked, signalled, ended."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

import httpx
from prometheus_client.parser import text_string_to_metric_families

PROGRAM = """
import typer
from terraport_server.cli import register
app = typer.Typer()
register(app)
app()
"""


class Supervised:
    """A context manager; the service is ready when it is entered."""

    def __init__(
        self, scenes: Path, *arguments: str, workers: int = 2, wait: bool = True, **settings: str
    ) -> None:
        with socket.create_server(("127.0.0.1", 0)) as probe:
            self.port = probe.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}"
        self.directory = scenes.parent
        """Where it runs: its `.env` is read there."""
        self._log = scenes.parent / f"serve-{self.port}.log"
        self._wait = wait
        options = ["--port", str(self.port), "--workers", str(workers), *arguments]
        variables = {f"TERRAPORT_{name.upper()}": value for name, value in settings.items()}
        with self._log.open("w") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-c", PROGRAM, str(scenes), *options],
                stdout=log,
                stderr=log,
                cwd=self.directory,
                env=os.environ | variables,
            )

    def __enter__(self) -> Self:
        if self._wait:
            self.until(lambda: "workers ready" in self.log, 60)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(30)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()

    @property
    def log(self) -> str:
        """Everything it has said so far."""
        return self._log.read_text()

    def until(self, what: Callable[[], bool], seconds: float) -> None:
        """Wait until something holds, looking 20 times a second."""
        until_s = time.monotonic() + seconds
        while not what():
            assert time.monotonic() < until_s, self.log
            time.sleep(0.05)

    def worker_pids(self) -> list[int]:
        """Processes that serve or served, oldest first."""
        return [int(number) for number in re.findall(r"worker ready .*process=(\d+)", self.log)]

    def roll(self, times: int = 1) -> None:
        """Replace all workers, so many times over."""
        for _ in range(times):
            before = self.log.count("rolling restart done")
            self.process.send_signal(signal.SIGHUP)
            self.until(lambda n=before: self.log.count("rolling restart done") > n, 200)

    def metrics(self) -> dict[str, float]:
        """Samples by `name{label=value,...}`, from whichever worker answers."""
        page = httpx.get(f"{self.url}/metrics").raise_for_status().text
        values = {}
        for family in text_string_to_metric_families(page):
            for sample in family.samples:
                labels = ",".join(f"{key}={value}" for key, value in sorted(sample.labels.items()))
                key = f"{sample.name}{{{labels}}}"
                assert key not in values
                values[key] = sample.value
        return values


def is_alive(pid: int) -> bool:
    """Whether there is such a process, and it is no zombie."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False
