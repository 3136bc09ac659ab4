"""What access costs: a token's check, the look at running sessions, bounds on HTTP connections.

``python benchmarks/access.py [--smoke]``. One process, medians of 5 rounds.
"""

from __future__ import annotations

import argparse
import json
import secrets
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))


from terraport_server.auth.gate import Gate, TokenPass
from terraport_server.auth.keys import KeyRing, TokenKey, new_key
from terraport_server.auth.tokens import StaticToken, make_token

STATIC = 100
SESSIONS = 2000


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description="What access costs.")
    parser.add_argument("--smoke", action="store_true", help="once, briefly")
    rounds, calls = (1, 20) if parser.parse_args().smoke else (5, 2000)
    print(json.dumps(measure_tokens(rounds, calls), indent=1))


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
