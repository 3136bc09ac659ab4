"""What access costs: a token's check, the look at running sessions, bounds on HTTP connections.

``python benchmarks/access.py [--smoke]``. One process, medians of 5 rounds.
"""

from __future__ import annotations

import argparse
import http.client
import json
import secrets
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import uvicorn

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from server.grid_scene import write_grid_scene
from terraport_server.http_connection import http_protocol_class

from terraport_server import Settings
from terraport_server.app import create_app
from terraport_server.auth.gate import Gate, TokenPass
from terraport_server.auth.keys import KeyRing, TokenKey, new_key
from terraport_server.auth.tokens import StaticToken, make_token

STATIC = 100
SESSIONS = 2000


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description="What access costs.")
    parser.add_argument("--smoke", action="store_true", help="once, briefly")
    rounds, calls, requests = (1, 20, 20) if parser.parse_args().smoke else (5, 2000, 2000)
    print(json.dumps(measure_tokens(rounds, calls) | measure_http(rounds, requests), indent=1))


def measure_tokens(rounds: int, calls: int) -> dict[str, float]:
    """Return microseconds per check, and milliseconds per look at all sessions."""
    hmac_key, ed_key = new_key("h", "HS256"), new_key("e", "EdDSA")
    static = [StaticToken(f"n{n}", secrets.token_urlsafe(32)) for n in range(STATIC)]
    gate = Gate(static, KeyRing((hmac_key, ed_key.public()), frozenset()))

    def token(key: TokenKey) -> str:
        expires_s = int(time.time()) + 3600
        return make_token(key, name="anna", scenes=frozenset({"pit"}), expires_s=expires_s)

    shown = {
        f"static_of_{STATIC}": static[50].token,
        "HS256": token(hmac_key),
        "EdDSA": token(ed_key),
        "unknown": "x" * 200,
    }
    result = {
        f"check_{name}_us": 1e6 * median(rounds, lambda t=token: gate.find(t), calls)
        for name, token in shown.items()
    }
    passes = [gate.find(shown["HS256"]) for _ in range(SESSIONS)]

    def look() -> None:
        for token_pass in passes:
            assert isinstance(token_pass, TokenPass)
            assert gate.withdrawal(token_pass, "pit") is None

    result[f"look_at_{SESSIONS}_sessions_ms"] = 1e3 * median(rounds, look, 1)
    return {name: round(value, 2) for name, value in result.items()}


def measure_http(rounds: int, requests: int) -> dict[str, float]:
    """Return GET /healthz per second on one connection: uvicorn's class and ours, in turn."""
    with tempfile.TemporaryDirectory() as folder:
        write_grid_scene(Path(folder) / "pit", cells=2)
        settings = Settings(scenes_dir=Path(folder))
        ours = http_protocol_class(settings, lambda *_: None)
        per_second: dict[str, list[float]] = {"uvicorn": [], "bounded": []}
        for _ in range(rounds):
            for name, protocol in (("uvicorn", "httptools"), ("bounded", ours)):
                per_second[name].append(requests_per_s(settings, protocol, requests))
    rates = {f"http_{name}_per_s": round(statistics.median(s)) for name, s in per_second.items()}
    ratios = [b / u for b, u in zip(per_second["bounded"], per_second["uvicorn"], strict=True)]
    return {**rates, "http_bounded_over_uvicorn": round(statistics.median(ratios), 3)}


def requests_per_s(settings: Settings, protocol: str | type, requests: int) -> float:
    """Serve in a thread, ask on one connection."""
    config = uvicorn.Config(
        create_app(settings), port=0, http=protocol, log_config=None, access_log=False
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    connection = http.client.HTTPConnection("127.0.0.1", port)
    began_s = time.perf_counter()
    for _ in range(requests):
        connection.request("GET", "/healthz")
        assert connection.getresponse().read() == b"ok\n"
    taken_s = time.perf_counter() - began_s
    connection.close()
    server.should_exit = True
    thread.join()
    return requests / taken_s


def median(rounds: int, call: Callable[[], object], calls: int) -> float:
    """Return the median over rounds of seconds per call."""
    durations_s = []
    for _ in range(rounds):
        began_s = time.perf_counter()
        for _ in range(calls):
            call()
        durations_s.append((time.perf_counter() - began_s) / calls)
    return statistics.median(durations_s)


if __name__ == "__main__":
    main()
