from __future__ import annotations

import subprocess
import sys
import time

import numpy as np

from terraport_pipeline.measure import Measure


def test_time_and_memory_of_a_block() -> None:
    with Measure() as measure:
        held = np.ones(50 * 2**20, dtype=np.uint8)
        time.sleep(0.2)
    with Measure() as after:
        time.sleep(0.01)
    assert 0.2 <= measure.seconds < 2.0
    assert held.nbytes <= measure.peak_bytes
    assert after.seconds < measure.seconds


def test_children_count() -> None:
    script = "import time; b = bytearray(80 * 2**20); print('up', flush=True); time.sleep(1)"
    with Measure() as alone:
        time.sleep(0.05)
    with (
        Measure() as measure,
        subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE) as child,
    ):
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(0.3)
        child.kill()
    assert measure.peak_bytes - alone.peak_bytes > 70 * 2**20
