"""The wall clock jumps: nothing that counts time may notice. Only what expires by date does."""

from __future__ import annotations

import re
import time
from pathlib import Path

from faults.service import Service
from server.grid_scene import SIDE, TILE_M, write_grid_scene
from server.plain_client import PlainClient, assemble

from terraport_wire import Credit, Plan, Ready

# The service, with a wall clock that is off by what a file says: every way in which Python code
# asks for the date. The monotonic clock is left alone, as the kernel leaves it.
PROGRAM = """
import pathlib, sys, time
real_s, real_ns = time.time, time.time_ns
def off():
    return float(pathlib.Path({file!r}).read_text())
time.time = lambda: real_s() + off()
time.time_ns = lambda: real_ns() + int(off() * 1e9)
from terraport.cli import main
sys.exit(main())
"""
DAY_S = 86_400.0
JUMPS_S = (DAY_S, -DAY_S, 1000 * DAY_S)
"""Against the true time, one after the other."""
CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)


def test_jumps_in_the_middle_of_landings(tmp_path: Path) -> None:
    """Landings go on, nobody is idle or late, new clients come in, messages are no flood."""
    scene = write_grid_scene(tmp_path / "scenes" / "grid", cells=12)
    file = tmp_path / "off"
    file.write_text("0")
    program = PROGRAM.format(file=str(file))
    total = sum(map(len, scene.payloads))
    with Service(tmp_path / "scenes", program=program, idle_timeout_s=5.0) as service:
        url = f"{service.url}/scenes/grid"
        for jump_s in JUMPS_S:
            with PlainClient(url) as client:
                client.hello(credit_bytes=total // 2)
                client.land(1, CENTRE, 100.0)
                client.expect(Plan)
                file.write_text(str(jump_s))
                time.sleep(1.2)  # a look at the scenes, and several ticks, in the new time
                client.send(Credit(bytes=12 * total))
                payloads = assemble(client.until(Ready)[1])
                assert [payloads[number] for number in range(SIDE * SIDE)] == scene.payloads
                for generation in range(2, 12):
                    client.land(generation, CENTRE, 5.0)
                    client.until(Ready)
        # The log shows that the service did see the other dates.
        assert " error " not in service.log
        dates = set(re.findall(r"^(\d{4}-\d\d-\d\d)", service.log, re.MULTILINE))
        assert len(dates) > len(JUMPS_S), dates


def test_who_asks_for_the_date() -> None:
    """Every use of the wall clock in the service is known: what it is, and why it may be."""
    import terraport_server

    allowed = {
        "auth/gate.py": "tokens that expire by date",
        "auth/cli.py": "the same, when they are made and looked at",
        "http/strokes.py": "when a stroke was painted; nothing runs by it",
    }
    asks = re.compile(r"time\.time\b|time_ns\(|datetime\.now|utcnow|date\.today|localtime|gmtime\(")
    folder = Path(terraport_server.__file__).parent
    askers = {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*.py")
        if asks.search(path.read_text())
    }
    assert askers == allowed.keys()
