"""What ``segmentation.py`` prints: the stages of a run, and which bars are met."""

from __future__ import annotations

from typing import Any, Final

__all__ = ["ONE", "PLAIN", "PLAIN_SHUFFLED", "SHUFFLED", "show", "verdict"]

BARS: Final = (
    ("TPA, 12 M faces, arrays to labels", 11_500_000, "TPA, arrays to labels", "s", 20.0),
    ("the same, stretch", 11_500_000, "TPA, arrays to labels", "s", 10.0),
    ("peak memory of it", 11_500_000, "TPA, arrays to labels", "MiB", 2048.0),
    ("graph, 5 M faces, arrays to labels", 4_900_000, "graph, arrays to labels", "s", 60.0),
    ("whole chain, 5 M faces", 4_900_000, "whole chain", "s", 120.0),
)
ONE, SHUFFLED = "TPA, one thread", "TPA, one thread, shuffled"
PLAIN, PLAIN_SHUFFLED = "plain NumPy and SciPy", "plain NumPy and SciPy, shuffled"
THESIS: Final = "thesis, table 5.4: 12 M faces took 22 h on ten cores"


def show(result: dict[str, Any], title: str) -> None:
    """Print what each stage of a run cost, and the run's other figures."""
    print(f"\n{title}: {result['faces']:,} faces, {result['threads']} threads")
    print(f"  {'':<34}{'wall s':>9}{'CPU s':>9}{'ns/face':>9}{'peak MiB':>10}")
    for stage, cost in result["stages"].items():
        per_face = 1e9 * cost["s"] / result["faces"]
        seconds = f"{cost['s']:>9.2f}{cost['cpu_s']:>9.2f}{per_face:>9.0f}"
        print(f"  {stage:<34}{seconds}{cost['MiB']:>10.0f}")
    for name, value in result.items():
        if name not in ("stages", "faces", "threads"):
            print(f"  {name}: {value}")


def verdict(results: list[dict[str, Any]]) -> None:
    """Say which bars are met: each at the nearest size that was measured, the worst of its runs."""
    print(f"\n{'bar':<40}{'measured':>12}{'allowed':>10}")
    for name, size, stage, unit, allowed in BARS:
        near = [r for r in results if size <= r["faces"] < 1.2 * size and stage in r["stages"]]
        if near:
            worst = max(r["stages"][stage][unit] for r in near)
            _say(name, worst, allowed, unit)
    by_size = sorted((r for r in results if r["noise"] == results[0]["noise"]), key=_faces)
    if len(by_size) > 1 and by_size[-1]["faces"] > 20 * by_size[0]["faces"]:
        per_face = [r["stages"]["TPA, arrays to labels"]["s"] / r["faces"] for r in by_size]
        _say("time per face, largest over smallest", per_face[-1] / per_face[0], 1.3, "x")
        cpu = [r["stages"]["TPA, arrays to labels"]["cpu_s"] / r["faces"] for r in by_size]
        _say("the same in CPU seconds", cpu[-1] / cpu[0], 1.3, "x")
    # Shuffled against in order; and what compiled kernels have over a page of NumPy.
    for result in by_size:
        cpu_s = {name: cost["cpu_s"] for name, cost in result["stages"].items()}
        size = f"{result['faces']:,} faces"
        ratio = cpu_s[SHUFFLED] / max(cpu_s[ONE], 1e-3)
        _say(f"{size}: shuffled over in order, CPU", ratio, 2.0, "x")
        if PLAIN in cpu_s:
            for plain, ours in ((PLAIN, ONE), (PLAIN_SHUFFLED, SHUFFLED)):
                times = cpu_s[plain] / max(cpu_s[ours], 1e-3)
                print(f"  {size}, {plain}: {cpu_s[plain]:.2f} CPU s, {times:.1f} x TPA")
    print(f"({THESIS}; a plain version on one core is the fairer comparison)")


def _faces(result: dict[str, Any]) -> int:
    return int(result["faces"])


def _say(name: str, value: float, allowed: float, unit: str) -> None:
    met = "met" if value <= allowed else "MISSED"
    print(f"{name:<40}{value:>8.2f} {unit:<3}{allowed:>7.4g} {unit:<4}{met}")
