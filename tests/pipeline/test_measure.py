from __future__ import annotations

import subprocess
import sys
import time

import numpy as np

from terraport_pipeline.measure import Measure, StepClock
from terraport_pipeline.progress import NullProgress


def test_time_and_memory_of_a_block() -> None:
    with Measure() as measure:
        block = np.ones(50 * 2**20, dtype=np.uint8)
        time.sleep(0.2)
    with Measure() as after:
        time.sleep(0.01)
    assert 0.2 <= measure.seconds < 2.0
    assert block.nbytes <= measure.peak_bytes
    assert after.seconds < measure.seconds


def test_children_count() -> None:
    script = "import time; b = bytearray(80 * 2**20); print('up', flush=True); time.sleep(9)"
    with Measure() as alone:
        time.sleep(0.05)
    with (
        Measure() as measure,
        subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE) as child,
    ):
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(0.6)  # children are listed every quarter of a second
        child.kill()
    assert measure.peak_bytes - alone.peak_bytes > 70 * 2**20


def test_steps_are_noted_with_their_time() -> None:
    clock = StepClock(NullProgress())
    clock.start("one", None, "points")
    time.sleep(0.05)
    clock.advance(3.0)
    clock.start("two", 5.0, "faces")  # ends the first, which forgot
    deadline = time.process_time() + 0.05
    while time.process_time() < deadline:
        pass
    clock.done({})
    clock.done({})
    assert [step.name for step in clock.steps] == ["one", "two"]
    assert clock.steps[0].seconds >= 0.05
    assert clock.steps[1].cpu_seconds > 0.03  # its clock ticks in hundredths
