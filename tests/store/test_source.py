"""One suite for every source: file, memory map, memory, slow, and object storage of all kinds."""

from __future__ import annotations

import http.server
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import xxhash
from s3_servers import s3_environment

from terraport_store import (
    FileSource,
    PayloadSource,
    RangeError,
    SegmentIndex,
)
from terraport_store.byte_cache import ByteCache
from terraport_store.origin import ObjectOptions, Origin
from terraport_store.remote_source import RemoteSource
from terraport_store.shelf import Shelf
from terraport_store.source import PayloadRange

DATA = np.random.default_rng(2).integers(0, 256, 300_000).astype(np.uint8).tobytes()

LOCAL = ["file", "slow"]
REMOTE = ["object-memory", "object-folder", "http", "s3-moto", "s3-seaweedfs", "s3-without-disk"]

Make = Callable[[bytes], PayloadSource]


class SlowSource(FileSource):
    """A disk that takes its time."""

    def read(self, offset: int, length: int) -> bytes:
        time.sleep(0.002)
        return super().read(offset, length)


def index_of(data: bytes) -> SegmentIndex:
    """Payloads of 1 to 40 KB with gaps between them, the last one short."""
    starts, lengths = [], []
    at, number = 64, 0
    while at < len(data) - 500:
        length = min(1000 + number * 4999 % 40_000, len(data) - at)
        starts.append(at)
        lengths.append(length)
        at = -(-(at + length) // 64) * 64 + 64 * (number % 3)
        number += 1
    count = len(starts)
    return SegmentIndex(
        bounds=np.tile(np.array([0, 0, 0, 1, 1, 1], np.float32), (count, 1)),
        vertex_count=np.ones(count, np.uint32),
        face_count=np.ones(count, np.uint32),
        offset=np.array(starts, np.uint64),
        length=np.array(lengths, np.uint32),
        xxh3=np.array(
            [
                xxhash.xxh3_64_intdigest(data[start : start + length])
                for start, length in zip(starts, lengths, strict=True)
            ],
            np.uint64,
        ),
        region=np.zeros(count, np.uint32),
        region_count=np.ones(count, np.uint16),
        texture=np.zeros((count, 3), dtype="<u2"),
    )


def remote_source(
    origin: Origin, data: bytes, *, cache_dir: Path | None = None, cache_bytes: int = 1 << 30
) -> RemoteSource:
    cache = None if cache_dir is None else ByteCache(cache_dir, cache_bytes)
    return RemoteSource(
        origin,
        "pack",
        len(data),
        index_of(data),
        shelf=Shelf(origin.options.memory_bytes),
        cache=cache,
        scope="test",
    )


class _QuietFiles(http.server.SimpleHTTPRequestHandler):
    """Static files with ranges, as any web server has them."""

    def do_GET(self) -> None:
        data = Path(self.translate_path(self.path)).read_bytes()
        range_header = self.headers.get("range")
        first, last = 0, len(data) - 1
        if range_header is not None:
            first, last = (int(bound) for bound in range_header.removeprefix("bytes=").split("-"))
            last = min(last, len(data) - 1)
        body = data[first : last + 1]
        self.send_response(200 if range_header is None else 206)
        if range_header is not None:
            self.send_header("content-range", f"bytes {first}-{last}/{len(data)}")
        self.send_header("content-length", str(len(body)))
        self.send_header("last-modified", self.date_time_string())
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """No line per request in the output of the tests."""


def file_server(folder: Path, until: ExitStack) -> str:
    handler = partial(_QuietFiles, directory=str(folder))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    until.callback(server.server_close)
    until.callback(server.shutdown)
    return f"http://127.0.0.1:{server.server_address[1]}"


@pytest.fixture(params=LOCAL + REMOTE)
def make(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Make]:
    kind: str = request.param
    with ExitStack() as until:
        endpoint = None
        if kind.startswith("s3"):
            endpoint = request.getfixturevalue("weed" if kind == "s3-seaweedfs" else "moto")
        if kind in REMOTE:
            until.enter_context(s3_environment(endpoint))

        def build(data: bytes) -> PayloadSource:
            path = tmp_path / "pack"
            path.write_bytes(data)
            local: dict[str, Callable[[], PayloadSource]] = {
                "file": lambda: FileSource(path),
                "slow": lambda: SlowSource(path),
            }
            source = local[kind]() if kind in local else remote(data)
            until.callback(source.close)
            return source

        def remote(data: bytes) -> PayloadSource:
            options = ObjectOptions(timeout_s=5.0)
            if kind == "object-memory":
                from obstore.store import MemoryStore

                origin = Origin("memory:///", options, store=MemoryStore())
            elif kind == "object-folder":
                origin = Origin(f"file://{tmp_path}", options)
            elif kind == "http":
                origin = Origin(file_server(tmp_path, until), options)
            else:
                origin = Origin(f"s3://packs/{tmp_path.name}", options)
            if kind not in {"object-folder", "http"}:
                origin.put("pack", data)
            without_disk = kind in {"object-memory", "s3-without-disk"}
            return remote_source(
                origin, data, cache_dir=None if without_disk else tmp_path / "cache"
            )

        yield build


@pytest.mark.parametrize(
    ("offset", "length"), [(0, 0), (0, 1), (299_999, 1), (300_000, 0), (1234, 70_000), (0, 300_000)]
)
def test_reads_exactly_what_was_asked(make: Make, offset: int, length: int) -> None:
    source = make(DATA)
    assert source.size == len(DATA)
    assert bytes(source.read(offset, length)) == DATA[offset : offset + length]


@pytest.mark.parametrize(
    ("offset", "length"), [(-1, 1), (0, -1), (0, 300_001), (300_000, 1), (2**62, 2**62)]
)
def test_refuses_what_is_not_there(make: Make, offset: int, length: int) -> None:
    source = make(DATA)
    for ask in (source.read, source.file_range):
        with pytest.raises(RangeError, match=f"{length} bytes at {offset}, expected within 0 to"):
            ask(offset, length)


def test_threads_may_read_at_once(make: Make) -> None:
    source = make(DATA)

    def read(number: int) -> bool:
        offset = number * 997 % 290_000
        return bytes(source.read(offset, 5000)) == DATA[offset : offset + 5000]

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(read, range(100)))


def test_every_payload_whole_and_in_parts(make: Make) -> None:
    """As a landing asks: hints, the whole payload for its hash, then chunks from where it lies."""
    source = make(DATA)
    index = index_of(DATA)
    ranges = list(zip(index.offset.tolist(), index.length.tolist(), strict=True))
    source.expect(ranges)
    for offset, length in ranges:
        assert bytes(source.read(offset, length)) == DATA[offset : offset + length]
        assert source.recall(offset, length)
        start, part_length = offset + length // 3, length // 2
        assert at_once(source, start, part_length) == DATA[start : start + part_length]


def at_once(source: PayloadSource, offset: int, length: int) -> bytes:
    """What the service sends without a wait."""
    file_range = source.file_range(offset, length)
    if isinstance(file_range, PayloadRange):
        assert file_range.length == length
        return os.pread(file_range.descriptor, length, file_range.offset)
    cached = source.held(offset, length)
    assert cached is not None
    return bytes(cached)


def test_bytes_at_hand_outlive_the_source(make: Make) -> None:
    """A frame that is being sent when the scene closes stays readable, if it is not a plain file's
    (which the service closes with its last client)."""
    source = make(DATA)
    offset, length = int(index_of(DATA).offset[3]), int(index_of(DATA).length[3])
    source.read(offset, length)
    source.recall(offset, length)
    file_range = source.file_range(offset, length)
    cached = source.held(offset, length)
    source.close()
    if file_range is not None and file_range.keeper is not None:
        data = os.pread(file_range.descriptor, file_range.length, file_range.offset)
        assert data == DATA[offset : offset + length]
    elif cached is not None:
        assert bytes(cached) == DATA[offset : offset + length]
    else:
        assert isinstance(source, FileSource)


def test_close_twice_is_fine(make: Make) -> None:
    source = make(DATA)
    source.interrupt()
    source.close()
    source.close()


def test_view_in_use_survives_close(tmp_path: Path) -> None:
    """A frame that is being sent when the scene closes stays readable."""
    path = tmp_path / "pack"
    path.write_bytes(DATA)
    source = FileSource(path)
    view = source.view(100, 50)
    source.close()
    assert view is not None
    assert bytes(view) == DATA[100:150]


def test_file_cut_short_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "pack"
    path.write_bytes(DATA)
    source = FileSource(path)
    with path.open("r+b") as file:
        file.truncate(1000)
    with pytest.raises(RangeError, match="expected within 0 to 1000"):
        source.read(900, 200)
    source.close()
