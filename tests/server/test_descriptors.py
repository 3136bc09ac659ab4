"""The limit of open files is raised as far as the system allows."""

from __future__ import annotations

import subprocess
import sys

import pytest

resource = pytest.importorskip("resource")

SCRIPT = """
import resource
from terraport_server.descriptors import has_free_descriptors, most_packs, raise_limit
resource.setrlimit(resource.RLIMIT_NOFILE, (300, 1000))
raise_limit()
files = []
while has_free_descriptors():
    files.append(open("/dev/null"))
print(resource.getrlimit(resource.RLIMIT_NOFILE)[0], len(files), most_packs())
"""


def test_the_limit_is_raised_and_a_reserve_is_left() -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, timeout=60
    )
    limit, connections, packs = map(int, done.stdout.split())
    assert limit == 1000
    assert 800 < connections < 950
    assert 2 * packs < connections
