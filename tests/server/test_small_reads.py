"""What a stranger sends is handed on in pieces, copied out of a buffer that all share."""

from __future__ import annotations

import asyncio

from terraport_server.small_reads import READ_BYTES, SmallReads


class Reader(asyncio.Protocol):
    def __init__(self) -> None:
        self.pieces: list[bytes] = []

    def data_received(self, data: bytes) -> None:
        self.pieces.append(data)


def test_pieces_are_copies_and_small() -> None:
    room, sent = memoryview(bytearray(READ_BYTES)), bytes(range(256)) * 1000
    readers: list[Reader] = []

    async def work() -> None:
        loop = asyncio.get_running_loop()

        def come() -> SmallReads:
            readers.append(Reader())
            return SmallReads(readers[-1], room)

        server = await loop.create_server(come, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        writers = [(await asyncio.open_connection("127.0.0.1", port))[1] for _ in range(3)]
        for writer in writers:
            writer.write(sent)
        deadline_s = loop.time() + 20
        while sum(len(piece) for one in readers for piece in one.pieces) < 3 * len(sent):
            await asyncio.sleep(0.001)
            assert loop.time() < deadline_s
        for writer in writers:
            writer.close()
        server.close()

    asyncio.run(asyncio.wait_for(work(), 30))
    assert [b"".join(one.pieces) for one in readers] == [sent] * 3
    assert max(len(piece) for one in readers for piece in one.pieces) <= READ_BYTES
