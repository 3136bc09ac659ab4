"""One worker process by itself, with a test in the place of its supervisor."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
from server.grid_scene import write_grid_scene

from terraport_server.control import Channel
from terraport_server.listeners import Listeners


async def heard(channel: Channel) -> dict[str, Any]:
    """What the worker says beside that it is alive."""
    while True:
        message = await channel.hear()
        assert message is not None
        if message["kind"] != "alive":
            return message


def test_a_worker_serves_answers_and_ends_with_its_supervisor(tmp_path: Path) -> None:
    write_grid_scene(tmp_path / "pit")

    async def work() -> None:
        listeners = Listeners("127.0.0.1", 0, 1)
        (listener,) = listeners.of(0)
        url = f"http://127.0.0.1:{listeners.port}"
        ours, theirs = socket.socketpair()
        with theirs:
            numbers = (theirs.fileno(), listener.fileno())
            command = [sys.executable, "-m", "terraport_server.worker", str(theirs.fileno())]
            process = await asyncio.create_subprocess_exec(
                *command, pass_fds=numbers, stderr=subprocess.PIPE
            )
        channel = await Channel.open(ours)
        settings = {"scenes_dir": str(tmp_path), "token": "sixteen-characters", "public_metrics": 1}
        start = {"slot": 0, "listeners": [[listener.fileno()]], "mailbox": None}
        channel.say("start", settings=settings, **start)
        assert await channel.hear() == {"kind": "ready"}
        # Nobody else could have told it the token: no argument and no variable has it.
        async with httpx.AsyncClient(
            headers={"Authorization": "Bearer sixteen-characters"}
        ) as http:
            assert [s["id"] for s in (await http.get(f"{url}/scenes")).json()["scenes"]] == ["pit"]
            assert (await http.get(f"{url}/scenes", headers={"Authorization": ""})).is_error
            # It asks its supervisor for everybody's metrics.
            scrape = asyncio.create_task(http.get(f"{url}/metrics"))
            request = await heard(channel)
            assert request == {"kind": "scrape", "number": 1}
            channel.say("measure")
            answer = await heard(channel)
            assert "terraport_sessions_active" in answer["page"]
            channel.say("merged", number=1, page="all_of_us 7\n")
            assert (await scrape).text == "all_of_us 7\n"
        # The supervisor is gone: no process is left over, and it ends in order.
        await channel.close()
        async with asyncio.timeout(20):
            _, log = await process.communicate()
        assert process.returncode == 0, log
        assert b"Traceback" not in log
        listeners.close()

    asyncio.run(asyncio.wait_for(work(), 60))


def test_a_worker_that_cannot_serve_says_why_in_one_line(tmp_path: Path) -> None:
    """As after a rolling restart over a file of tokens that somebody has broken."""
    (tmp_path / "tokens").write_text("name short\n")
    ours, theirs = socket.socketpair()
    with ours, theirs:
        settings = {"scenes_dir": str(tmp_path), "tokens_file": str(tmp_path / "tokens")}
        start = {"kind": "start", "settings": settings, "slot": 0, "listeners": [[]]}
        start["mailbox"] = None
        ours.sendall(json.dumps(start).encode() + b"\n")
        process = subprocess.run(
            [sys.executable, "-m", "terraport_server.worker", str(theirs.fileno())],
            pass_fds=(theirs.fileno(),),
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert process.returncode == 1
    (line,) = process.stderr.splitlines()
    assert "worker cannot serve" in line
    assert "tokens line 1: got a token of 5 characters" in line
