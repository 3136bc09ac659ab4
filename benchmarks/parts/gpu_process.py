"""CPU time of a browser's process for the GPU: by SwiftShader, what drawing costs."""

from __future__ import annotations

from pathlib import Path

__all__ = ["cpu_ms", "gpu_process"]


def gpu_process(mark: str) -> int:
    """Return its id; ``mark`` stands in the browser's command line, such as its user agent."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command = (process / "cmdline").read_bytes().decode(errors="ignore")
        except OSError:
            continue
        if "--type=gpu-process" in command and mark in command:
            return int(process.name)
    raise SystemExit("the browser has no process for the GPU")


def cpu_ms(process: int) -> float:
    """Return what a process has used since its start, milliseconds, in steps of ten."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) * 10.0  # ticks of a hundredth of a second
