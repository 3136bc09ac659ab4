from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "store.py"


def test_benchmark_runs_and_agrees(tmp_path: Path) -> None:
    """Small: it checks that both spatial indexes answer alike and that its scene is whole."""
    out = tmp_path / "out.json"
    command = [sys.executable, str(BENCHMARK), "--smoke", "--out", str(out)]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    results = json.loads(out.read_text())
    assert results["index"]["bytes_per_segment"] < 128
    assert results["payload"][0]["segment"]["bytes_per_triangle"] < 25
