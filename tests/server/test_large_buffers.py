"""Buffers that the process keeps: asked of the kernel by the page faults that it counts."""

from __future__ import annotations

import os
import platform
import subprocess
import sys

import pytest

FAULTS = """
import resource, sys
from terraport_server.large_buffers import keep_large_buffers
assert keep_large_buffers(wanted=sys.argv[1] == "yes") == (sys.argv[1] == "yes")
def work():
    for _ in range(100):
        bytearray(1 << 20)
work()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
work()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def faults(wanted: str) -> int:
    command = [sys.executable, "-c", FAULTS, wanted]
    # Once given back, glibc's own threshold grows: as it is for buffers of many sizes.
    environment = {"MALLOC_MMAP_THRESHOLD_": "131072"} if wanted == "no" else {}
    done = subprocess.run(
        command, check=True, capture_output=True, text=True, env=os.environ | environment
    )
    return int(done.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc alone has mallopt")
def test_a_kept_buffer_costs_no_page_faults() -> None:
    assert faults("yes") < 100
    assert faults("no") > 10_000
