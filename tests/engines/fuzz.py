"""Feed damaged bytes to the readers of the Unreal plugin's core, with sanitizers.

    python tests/engines/fuzz.py [--seconds S | --runs N] [TARGET ...]

Builds ``client_sdk/unreal/fuzz`` with clang's libFuzzer, AddressSanitizer and
UndefinedBehaviorSanitizer; runs each target (two at a time) and prints how many inputs it took.
Starts from the files of tests/conformance. Exit code 1: one crashed, leaked, or took too long; the
input lies where it says.
"""

from __future__ import annotations

import argparse
import base64
import json
import re
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

if __name__ == "__main__":  # run as a script: the package "engines" lies in tests/
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from engines import unreal

CORPUS = Path(__file__).resolve().parents[1] / "conformance"
MOST_BYTES = 1 << 16
"""Of one input: larger ones only take longer."""
SLOWEST_S = 20
"""Of one input, on a busy machine: beyond it is a hang."""


def seeds_of(target: str) -> Iterator[bytes]:
    """Yield the corpora in the form that each target takes; its first lines say which."""
    if target == "segment":
        for path in sorted(CORPUS.glob("scene/payload/*.tsg")):
            yield b"\x04" + path.read_bytes()
    elif target == "scene":
        for path in sorted(CORPUS.glob("scene/*/**/*.json")):
            yield path.read_bytes()
    else:
        for path in sorted(CORPUS.glob("landings/*.jsonl")):
            for line in path.read_text().splitlines():
                steps = json.loads(line)["steps"]
                messages = [base64.b64decode(step[1]) for step in steps if step[0] == "receive"]
                yield b"".join(struct.pack("<H", len(each)) + each for each in messages)


def write_seeds(target: str, folder: Path) -> None:
    """Write the seeds of a target that are short enough."""
    folder.mkdir()
    for number, seed in enumerate(seeds_of(target)):
        if len(seed) <= MOST_BYTES:
            (folder / str(number)).write_bytes(seed)


def run(program: Path, limit: str, work: Path) -> tuple[str, int, str]:
    """Run one target; returns its name, how many inputs it took, and why it failed, if it did."""
    seeds = work / program.name
    write_seeds(program.name, seeds)
    done = subprocess.run(
        [
            str(program),
            str(seeds),
            limit,
            f"-max_len={MOST_BYTES}",
            f"-timeout={SLOWEST_S}",
            "-rss_limit_mb=2048",
            "-print_final_stats=1",
            "-verbosity=1",
            "-seed=1",
            f"-artifact_prefix={work}/",
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        check=False,
    )
    executed = re.search(r"number_of_executed_units: (\d+)", done.stdout)
    count = int(executed[1]) if executed else 0
    return program.name, count, "" if done.returncode == 0 and count else done.stdout[-6000:]


def main() -> int:
    """Build the fuzzers, run each for its time and report inputs per target."""
    parser = argparse.ArgumentParser(description="fuzz the core of the Unreal plugin")
    parser.add_argument("targets", nargs="*")
    parser.add_argument("--seconds", type=int, default=10, help="of each target")
    parser.add_argument("--runs", type=int, help="inputs of each target, in place of seconds")
    options = parser.parse_args()
    if shutil.which("clang++") is None or unreal.missing() is not None:
        sys.stdout.write("fuzz: left out (apt-get install clang cmake g++)\n")
        return 0
    built = unreal.unreal(
        "-DCMAKE_CXX_COMPILER=clang++",
        "-DCMAKE_CXX_FLAGS_RELEASE=-O1",  # compiles in half the time, and inputs are small
        "-DTERRAPORT_FUZZ=ON",
        name="fuzz",
    )
    names = sorted(path.name for path in (built.folder / "bin").iterdir())
    chosen = [name for name in names if not options.targets or name in options.targets]
    limit = f"-max_total_time={options.seconds}"
    if options.runs is not None:
        limit = f"-runs={options.runs}"
    # Kept where something was found: the input lies there.
    work = Path(tempfile.mkdtemp(prefix="terraport-fuzz-"))
    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(lambda name: run(built.folder / "bin" / name, limit, work), chosen))
    for name, count, failure in results:
        sys.stdout.write(f"{name:24}{count:>14,} inputs\n{failure}")
    total = sum(count for _, count, _ in results)
    failed = [name for name, _, failure in results if failure]
    sys.stdout.write(f"{'in all':24}{total:>14,} inputs, {len(failed)} targets failed\n")
    if not failed:
        shutil.rmtree(work)
    return 1 if failed or not results else 0


if __name__ == "__main__":
    sys.exit(main())
