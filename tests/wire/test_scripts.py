"""The fuzzer and the benchmark run, once and briefly."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def _run(*arguments: str) -> str:
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_second_of_fuzzing_finds_documented_errors_only() -> None:
    assert "inputs" in _run("fuzz/wire.py", "--seconds", "1")


def test_the_benchmark_runs() -> None:
    results = json.loads(_run("benchmarks/wire.py", "--smoke"))
    assert results["plan"]["bytes"] > results["land"]["bytes"] > 0
