"""A pack in object storage when things go wrong; the rest is in test_source.py."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from s3_servers import Fault, FaultProxy, ProxiedRequest, Rule, s3_environment
from store.test_byte_cache import full_disk
from store.test_source import DATA, at_once, index_of, remote_source

from terraport_store import CorruptPayloadError, OriginError
from terraport_store.origin import ObjectOptions, Origin
from terraport_store.remote_source import RemoteSource

INDEX = index_of(DATA)
PLACES = list(zip(INDEX.offset.tolist(), INDEX.length.tolist(), strict=True))


@pytest.fixture
def proxy(weed: str) -> Iterator[FaultProxy]:
    with FaultProxy(weed) as between, s3_environment(between.url):
        yield between


@pytest.fixture
def source(proxy: FaultProxy, tmp_path: Path) -> Iterator[RemoteSource]:
    url = f"s3://packs/{tmp_path.name}"
    Origin(url, ObjectOptions(part_retries=5)).put("pack", DATA)
    origin = Origin(url, ObjectOptions(timeout_s=2.0, requests=4))
    opened = remote_source(origin, DATA, cache_dir=tmp_path / "cache")
    yield opened
    opened.close()


def expected(piece: int) -> bytes:
    offset, length = PLACES[piece]
    return DATA[offset : offset + length]


def counts(source: RemoteSource) -> dict[str, int]:
    return {name: number for name, number in vars(source._counts).items() if name != "_lock"}


def times(number: int, fault: Fault) -> Rule:
    """The fault for so many reads of the pack, then none."""
    left = [number]

    def rule(request: ProxiedRequest) -> Fault | None:
        if request.method != "GET" or left[0] <= 0:
            return None
        left[0] -= 1
        return fault

    return rule


@pytest.mark.parametrize(
    "fault", [Fault(status=503), Fault(status=500), Fault(status=429), Fault(cut_at=100)]
)
def test_what_passes_is_tried_again(proxy: FaultProxy, source: RemoteSource, fault: Fault) -> None:
    proxy.rule = times(2, fault)
    assert source.read(*PLACES[3]) == expected(3)
    assert counts(source)["retries"] == 2
    assert counts(source)["failures"] == 0


def test_an_answer_that_stalls_is_given_up_and_asked_for_again(
    proxy: FaultProxy, source: RemoteSource
) -> None:
    proxy.rule = times(1, Fault(delay_s=1.5))
    began_s = time.monotonic()
    assert source.read(*PLACES[3]) == expected(3)
    assert time.monotonic() - began_s < 1.4  # stall_s is 0.5
    assert counts(source)["retries"] == 1


@pytest.mark.parametrize("status", [403, 404])
def test_what_does_not_pass_is_not_tried_again(
    proxy: FaultProxy, source: RemoteSource, status: int
) -> None:
    proxy.rule = lambda _: Fault(status=status)
    with pytest.raises((OriginError, FileNotFoundError)):
        source.read(*PLACES[3])
    assert counts(source)["retries"] == 0
    proxy.rule = lambda _: None
    assert source.read(*PLACES[3]) == expected(3)


def test_trouble_without_end_ends(proxy: FaultProxy, source: RemoteSource) -> None:
    """The first waits out the time allowed; the others are told at once; then it heals."""
    proxy.rule = lambda _: Fault(status=503)
    with pytest.raises(OriginError, match=r"503 Service Unavailable.*tries in"):
        source.read(*PLACES[0])
    # Pauses of 0.1 to 0.8 s, shortened by chance; the fifth would end beyond the 2 s allowed.
    assert 1 <= counts(source)["retries"] <= 4
    request_count = len(proxy.requests)
    for piece in range(1, 8):
        with pytest.raises(OriginError, match="not asked for: nothing came from there"):
            source.read(*PLACES[piece])
    assert len(proxy.requests) == request_count
    proxy.rule = lambda _: None
    time.sleep(0.55)  # cool_down_s is 0.5
    assert source.read(*PLACES[0]) == expected(0)
    assert source.read(*PLACES[1]) == expected(1)


def test_interrupt_ends_what_waits(proxy: FaultProxy, source: RemoteSource) -> None:
    proxy.rule = lambda _: Fault(status=503)
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(source.read, *PLACES[0])
        while not proxy.requests:
            time.sleep(0.01)
        began_s = time.monotonic()
        source.interrupt()
        with pytest.raises(OriginError):
            waiting.result(5)
    assert time.monotonic() - began_s < 0.5


def test_wrong_bytes_are_asked_for_once_more(proxy: FaultProxy, source: RemoteSource) -> None:
    proxy.rule = times(1, Fault(flip_at=7))
    assert source.read(*PLACES[5]) == expected(5)
    assert counts(source)["wrong"] == 1


def test_wrong_bytes_are_never_kept_or_handed_out(
    proxy: FaultProxy, source: RemoteSource, tmp_path: Path
) -> None:
    proxy.rule = lambda _: Fault(flip_at=7)
    for _ in range(2):
        with pytest.raises(CorruptPayloadError, match="segment 5 has hash"):
            source.read(*PLACES[5])
    assert source.file_range(*PLACES[5]) is None
    assert source.held(*PLACES[5]) is None
    assert not source.recall(*PLACES[5])
    assert list((tmp_path / "cache").glob("test/*/*")) == []
    proxy.rule = lambda _: None
    assert source.read(*PLACES[5]) == expected(5)


def test_a_rotten_cache_file_heals(source: RemoteSource, tmp_path: Path) -> None:
    """Also one that is open: a client's reject leads to a read, which compares the hash."""
    source.read(*PLACES[5])
    (path,) = (tmp_path / "cache").glob("test/*/*")
    with path.open("r+b") as file:
        file.write(b"rotten")
    assert at_once(source, *PLACES[5]) != expected(5)
    assert source.read(*PLACES[5]) == expected(5)
    assert at_once(source, *PLACES[5]) == expected(5)
    assert counts(source)["payloads_fetched"] == 2


def test_a_full_disk_costs_memory_only(source: RemoteSource, tmp_path: Path) -> None:
    with full_disk(64):
        assert source.read(*PLACES[5]) == expected(5)
        assert counts(source)["uncached"] == 1
        assert source.file_range(*PLACES[5]) is None
        assert at_once(source, *PLACES[5]) == expected(5)
    source.read(*PLACES[6])
    assert source.file_range(*PLACES[6]) is not None


def test_neighbours_are_fetched_by_one_request(proxy: FaultProxy, source: RemoteSource) -> None:
    proxy.requests.clear()
    source.expect(PLACES)
    while not proxy.requests:  # whoever reads before the hint was taken up asks for himself
        time.sleep(0.002)
    for piece, byte_range in enumerate(PLACES):
        assert source.read(*byte_range) == expected(piece)
    requests = proxy.of("/pack")
    assert len(requests) == 1
    assert sum(request.sent_bytes for request in requests) < len(DATA)
    assert counts(source)["payloads_fetched"] == len(PLACES)


def test_a_cold_start_reads_the_disk_not_the_network(
    proxy: FaultProxy, source: RemoteSource, tmp_path: Path
) -> None:
    for byte_range in PLACES:
        source.read(*byte_range)
    proxy.requests.clear()
    again = remote_source(source._origin.twin(), DATA, cache_dir=tmp_path / "cache")
    again.expect(PLACES)
    for piece, byte_range in enumerate(PLACES):
        assert again.recall(*byte_range)
        assert at_once(again, *byte_range) == expected(piece)
    again.close()
    assert proxy.requests == []


def test_who_needs_it_now_does_not_wait_behind_hints(
    proxy: FaultProxy, source: RemoteSource
) -> None:
    """Ahead of need, everything is slow; a payload that nobody hinted at comes at once."""
    slow = threading.Event()

    def rule(request: ProxiedRequest) -> Fault | None:
        if request.method == "GET" and not slow.is_set():
            slow.set()
            return Fault(delay_s=0.4)
        return None

    proxy.rule = rule
    source.expect(PLACES[:4])
    assert slow.wait(5)
    began_s = time.monotonic()
    assert source.read(*PLACES[9]) == expected(9)
    assert time.monotonic() - began_s < 0.3
    assert source.read(*PLACES[0]) == expected(0)


def test_many_who_want_the_same_ask_once(proxy: FaultProxy, source: RemoteSource) -> None:
    proxy.requests.clear()
    proxy.rule = lambda _: Fault(delay_s=0.1)
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: source.read(*PLACES[2]), range(8)))
    assert answers == [expected(2)] * 8
    assert len(proxy.of("/pack")) == 1


def test_hints_beyond_the_bound_are_dropped(proxy: FaultProxy, source: RemoteSource) -> None:
    source._ahead_bound = 1
    source._ahead_bytes = 1
    proxy.requests.clear()
    source.expect(PLACES)
    assert source.read(*PLACES[0]) == expected(0)
    assert len(proxy.of("/pack")) == 1
    assert counts(source)["payloads_fetched"] == 1
