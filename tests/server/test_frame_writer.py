"""The writer under a stalled client whose payload's file is cut short, in a process of its own."""

from __future__ import annotations

import asyncio
import mmap
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from terraport_server.stream.frame_writer import FrameWriter, message_header

FRAME_BYTES = 1 << 17


class Protocol(asyncio.Protocol):
    writer: FrameWriter
    lost = False

    def pause_writing(self) -> None:
        self.writer.pause()

    def resume_writing(self) -> None:
        self.writer.resume()

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost = True
        self.writer.lose()


def map_file(path: Path) -> memoryview:
    path.write_bytes(bytes(8 * FRAME_BYTES))
    with path.open("rb") as file:
        return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))


async def stall(path: Path, *, closes: bool) -> None:
    mapped = map_file(path)
    server, client = socket.socketpair()
    server.setblocking(False)
    client.setblocking(False)
    protocol = Protocol()
    transport, _ = await asyncio.get_running_loop().create_connection(lambda: protocol, sock=server)
    writer = protocol.writer = FrameWriter(transport)
    header = message_header(FRAME_BYTES)
    buffers, ends = [], []
    for number in range(8):
        buffers += [header, mapped[number * FRAME_BYTES : (number + 1) * FRAME_BYTES]]
        ends.append((number + 1) * (len(header) + FRAME_BYTES))
    assert writer.send_frames(buffers, ends) < 8
    os.truncate(path, 4096)
    if closes:
        writer.close()
    for _ in range(500):
        if protocol.lost:
            return
        await asyncio.sleep(0.01)
        try:
            client.recv(1 << 16)
        except BlockingIOError:
            continue
    raise AssertionError("the connection did not end")


@pytest.mark.parametrize("loop", ["asyncio", "uvloop"])
@pytest.mark.parametrize("closes", ["", "closes"])
def test_a_file_cut_short_costs_the_connection_and_not_the_process(
    tmp_path: Path, loop: str, closes: str
) -> None:
    """A signal of the kernel (SIGBUS) ends a process that touches what the file has lost."""
    pytest.importorskip(loop)
    code = (
        f"import sys, {loop}; from pathlib import Path; from server.test_frame_writer import stall;"
        f"{loop}.run(stall(Path(sys.argv[1]), closes={bool(closes)}))"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", code, str(tmp_path / "pack")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
