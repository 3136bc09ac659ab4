"""The limit of open files is raised to what the settings promise."""

from __future__ import annotations

import subprocess
import sys

import pytest

resource = pytest.importorskip("resource")

SCRIPT = """
import logging, resource, sys
from terraport_server.descriptors import make_room
logging.basicConfig(level="WARNING")
resource.setrlimit(resource.RLIMIT_NOFILE, (300, int(sys.argv[1])))
make_room(int(sys.argv[2]))
print(resource.getrlimit(resource.RLIMIT_NOFILE)[0])
"""


@pytest.mark.parametrize(
    ("hard", "connections", "granted", "warns"),
    [(4000, 1024, 4000, False), (1000, 1024, 1000, True), (4000, 10, 4000, False)],
)
def test_room_is_made_as_far_as_allowed(
    hard: int, connections: int, granted: int, warns: bool
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(hard), str(connections)],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert int(done.stdout) == granted
    assert ("few descriptors" in done.stderr) == warns
