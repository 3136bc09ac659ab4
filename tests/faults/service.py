"""`terraport serve` as a process that a test may kill and start again at the same address."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Self

from eventually import eventually

PROGRAM = "import sys; from terraport.cli import main; sys.exit(main())"


class Service:
    """A context manager; ready when it is entered."""

    def __init__(
        self, scenes: Path, *, program: str = PROGRAM, port: int | None = None, **settings: object
    ) -> None:
        if port is None:
            with socket.create_server(("127.0.0.1", 0)) as probe:
                port = probe.getsockname()[1]
        self.port = port
        self.url = f"http://127.0.0.1:{port}"
        self._log = scenes.parent / f"serve-{port}.log"
        self._command = [sys.executable, "-c", program, "serve", str(scenes), "--port", str(port)]
        self._environment = os.environ | {
            f"TERRAPORT_{name.upper()}": str(value) for name, value in settings.items()
        }
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        with self._log.open("ab") as log:
            self.process = subprocess.Popen(
                self._command, stdout=log, stderr=log, env=self._environment
            )
        eventually(self._answers, 60)

    def kill(self) -> None:
        """What the kernel does when memory is short: no goodbye."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    @property
    def alive(self) -> bool:
        return self.process is not None and self.process.poll() is None

    @property
    def log(self) -> str:
        return self._log.read_text()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        assert self.process is not None
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(20)
            except subprocess.TimeoutExpired:
                self.kill()

    def _answers(self) -> bool:
        assert self.alive, self.log
        try:
            socket.create_connection(("127.0.0.1", self.port), 1).close()
        except OSError:
            return False
        return True
