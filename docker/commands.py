"""Commands of other programs that must succeed, and a line for each thing that holds."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Final

BEGAN_S: Final = time.monotonic()


def say(text: str) -> None:
    """Print a line with the time since the start."""
    print(f"{time.monotonic() - BEGAN_S:6.1f} s  {text}", flush=True)


def tool(*names: str, probe: str = "--version") -> list[str] | None:
    """Return the first command of these that works, beside this interpreter or on PATH.

    `probe` is what it must answer; `docker compose --version` answers without its compose plugin,
    too, with Docker's own version.
    """
    for name in names:
        words = name.split()
        program = shutil.which(words[0], path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
        if program is None:
            continue
        command = [program, *words[1:]]
        if not subprocess.run([*command, probe], capture_output=True, check=False).returncode:
            return command
    return None


def check(command: list[str], what: str, **options: Any) -> str:
    """Run a command that must succeed."""
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    if done.returncode:
        sys.exit(f"failed: {what}\n{done.stdout}{done.stderr}")
    say(f"ok: {what}")
    return done.stdout
