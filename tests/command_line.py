"""The command line as a test runs it: in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Built:
    """A survey on disk and the folder of scenes that was made from it."""

    survey: Path
    scenes: Path

    @property
    def scene(self) -> Path:
        return self.scenes / "quarry"


def run_terraport(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own; never raises for its exit code."""
    return subprocess.run(
        [Path(sys.executable).with_name("terraport"), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
        env={**os.environ, **environment},
    )
