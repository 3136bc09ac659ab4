"""Landings from object storage beside landings from a file: time, requests, bytes.

::

    python benchmarks/object_storage.py            # a minute; needs SeaweedFS (terraport[dev])
    python benchmarks/object_storage.py --smoke    # small numbers, only to see that it works

A grid of segments of random bytes is published in a folder and uploaded to a SeaweedFS on loopback.
A service of its own process serves it; one client lands at nine places that share no segment: cold
(nothing cached), warm (a second client), and warm after a restart of the service. Then again with a
proxy that holds back each answer, as a store some 20 ms away would. Requests and bytes are the
service's own counts from ``/metrics``. Reported: medians over the places.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import statistics
import sys
import tempfile
import time
from contextlib import ExitStack
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Self

import httpx
import pytest
from parts.random_scene import TILE_M, write_random_scene
from parts.service_process import ServiceProcess
from prometheus_client.parser import text_string_to_metric_families

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from s3_servers import Fault, FaultProxy, s3_environment, weed_server
from server.plain_client import Piece, PlainClient

from terraport_store.origin import ObjectOptions
from terraport_store.upload import upload_scene
from terraport_wire import Credit, Ready

DELAY_S = 0.02


def main() -> None:
    """Parse arguments, measure, print JSON."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--smoke", action="store_true")
    smoke = parser.parse_args().smoke
    side, segment_bytes, radius_m = (12, 16_000, 15.0) if smoke else (48, 64_000, 66.0)
    with ExitStack() as until:
        # A scene on disk, and the same one in an object store on this machine.
        folder = Path(until.enter_context(tempfile.TemporaryDirectory(prefix="terraport-")))
        (folder / "s").mkdir()
        manifest = write_random_scene(folder / "s" / "grid", side=side, segment_bytes=segment_bytes)
        try:
            weed = until.enter_context(weed_server())
        except pytest.skip.Exception as error:  # the store cannot run here
            print(f"not run: {error}")
            return
        until.enter_context(s3_environment(weed))
        began_s = time.perf_counter()
        upload_scene(folder / "s" / "grid", "s3://scenes/bench/grid", ObjectOptions())
        upload_s = time.perf_counter() - began_s
        # Nine landings whose circles do not overlap, so that each finds nothing cached.
        places = [
            (side * TILE_M * (2 * column + 1) / 6, side * TILE_M * (2 * row + 1) / 6)
            for row in range(3)
            for column in range(3)
        ]
        places = places[:3] if smoke else places
        rows: dict[str, Any] = {}
        # From files, from the store as it is, and from the store behind a delay.
        with ServiceProcess(folder / "s") as service:
            rows["file, first time"] = landings(service, places, radius_m)
            rows["file, again"] = landings(service, places, radius_m)
        rows |= from_storage("s3", weed, folder / "cache-near", places, radius_m)
        if smoke:
            print(json.dumps(rows, indent=1))
            return
        proxy = until.enter_context(Delaying(weed, DELAY_S))
        far = f"s3 + {DELAY_S * 1e3:.0f} ms"
        rows |= from_storage(far, proxy.url, folder / "cache-far", places, radius_m)
        alone = f"{far}, no read-ahead"
        cache = folder / "cache-alone"
        rows |= from_storage(
            alone, proxy.url, cache, places, radius_m, only_cold=True, object_read_ahead_bytes=0
        )
        rows |= from_storage(
            "s3, no disk",
            weed,
            folder / "none",
            places,
            radius_m,
            only_cold=True,
            object_cache_bytes=0,
        )
    # One JSON document.
    pack_bytes = manifest.files["segments.pack"].bytes
    report = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        "scene": {"segments": side * side, "pack_bytes": pack_bytes, "radius_m": radius_m},
        "upload_s": round(upload_s, 2),
        "landings": rows,
    }
    print(json.dumps(report, indent=1))


def from_storage(
    name: str,
    endpoint: str,
    cache: Path,
    places: list[tuple[float, float]],
    radius_m: float,
    *,
    only_cold: bool = False,
    **settings: Any,
) -> dict[str, Any]:
    """Land cold, warm, and warm after a restart."""
    rows = {}
    settings |= {"object_endpoint": endpoint, "object_cache_dir": cache, "object_poll_s": 3600}
    url: Any = "s3://scenes/bench"
    with ServiceProcess(url, **settings) as service:
        rows[f"{name}, cold"] = landings(service, places, radius_m)
        if not only_cold:
            rows[f"{name}, warm"] = landings(service, places, radius_m)
    if not only_cold:
        with ServiceProcess(url, **settings) as service:
            rows[f"{name}, warm, restarted"] = landings(service, places, radius_m)
    return rows


def landings(
    service: ServiceProcess, places: list[tuple[float, float]], radius_m: float
) -> dict[str, Any]:
    """Land at every place once; medians."""
    wait_until_served(service)
    first_ms, ready_ms, payload, requests, fetched = [], [], [], [], []
    with PlainClient(f"{service.url}/scenes/grid") as client:
        client.hello()
        for generation, (x, z) in enumerate(places):
            before = counts(service)
            began_s = time.perf_counter()
            taken_bytes = client.taken_bytes
            client.land(generation, (x, 0.5, z), radius_m)
            first_s = None
            while not isinstance(message := client.receive(), Ready):
                if first_s is None and isinstance(message, Piece):
                    first_s = time.perf_counter()
            ready_ms.append((time.perf_counter() - began_s) * 1e3)
            assert message.missing is None, "segments are missing"
            payload_bytes = client.taken_bytes - taken_bytes
            client.send(Credit(bytes=payload_bytes))
            first_ms.append(((first_s or began_s) - began_s) * 1e3)
            after = counts(service)
            payload.append(payload_bytes)
            requests.append(after["requests"] - before["requests"])
            fetched.append((after["bytes"] - before["bytes"]) / payload_bytes)
    return {
        "first_byte_ms": round(statistics.median(first_ms), 1),
        "ready_ms": round(statistics.median(ready_ms), 1),
        "ready_ms_worst": round(max(ready_ms), 1),
        "payload_mb": round(statistics.median(payload) / 1e6, 2),
        "requests": statistics.median(requests),
        "fetched_over_payload": round(statistics.median(fetched), 3),
    }


def counts(service: ServiceProcess) -> dict[str, float]:
    """Count requests to storage so far, and bytes from there."""
    totals = {"requests": 0.0, "bytes": 0.0}
    for family in text_string_to_metric_families(httpx.get(f"{service.url}/metrics").text):
        name = family.name.removeprefix("terraport_object_")
        if name in totals and name != family.name:
            totals[name] = family.samples[0].value
    return totals


def wait_until_served(service: ServiceProcess) -> None:
    """Wait for the scene: a service may listen before it is open."""
    due_s = time.monotonic() + 30
    while httpx.get(f"{service.url}/scenes/grid").status_code != 200:
        if time.monotonic() > due_s:
            raise RuntimeError("the scene was not opened within 30 s")
        time.sleep(0.05)


class Delaying:
    """A proxy in a process of its own that answers later; a context manager."""

    def __init__(self, target: str, delay_s: float) -> None:
        self._here, child_end = multiprocessing.Pipe()
        self._process = multiprocessing.Process(
            target=_delay, args=(target, delay_s, child_end), daemon=True
        )
        self.url = ""

    def __enter__(self) -> Self:
        self._process.start()
        self.url = self._here.recv()
        return self

    def __exit__(self, *_: object) -> None:
        self._here.send("stop")
        self._process.join(10)


def _delay(target: str, delay_s: float, pipe: Connection) -> None:
    with FaultProxy(target, rule=lambda _: Fault(delay_s=delay_s)) as proxy:
        pipe.send(proxy.url)
        pipe.recv()


if __name__ == "__main__":
    main()
