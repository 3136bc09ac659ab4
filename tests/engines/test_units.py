"""The C++ core's own unit tests, run by doctest.

``python tests/engines/test_units.py`` prints what they say, with the corpora, for CI's log; where
the tests have just run on the same sources it prints what was said then.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

if __name__ == "__main__":  # run as a script: the package "engines" lies in tests/
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from engines import cores
from engines.programs import Client

TIMEOUT_S = 420


def run_doctest(program: Path) -> tuple[int, int, str]:
    """Run doctest's program; returns how many cases passed and failed, and what was said."""
    done = subprocess.run(
        [str(program), "--no-colors=true"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        timeout=TIMEOUT_S,
        check=False,
    )
    summary = re.search(r"test cases:\s+(\d+)\s*\|\s*(\d+) passed\s*\|\s*(\d+) failed", done.stdout)
    if summary is None or done.returncode not in (0, 1):
        return 0, 1, done.stdout
    _, passed, failed = map(int, summary.groups())
    return passed, failed, done.stdout


def test_the_cpp_core_passes_its_doctest_cases(cpp: cores.CppCore) -> None:
    passed, failed, output = run_doctest(cpp.tests)
    keep(cpp, failed, output)
    assert failed == 0, output[-6000:]
    assert passed > 60


def keep(core: cores.CppCore, failed: int, output: str) -> None:
    """Keep what the tests of a build said beside it; of failures nothing, they are run again."""
    path = core.folder / "unit-tests.log"
    path.unlink(missing_ok=True)
    if not failed:
        path.write_text(output)


def unit_tests(core: cores.CppCore) -> tuple[int, str]:
    """Return how many unit tests of a core fail, and what was said."""
    path = core.folder / "unit-tests.log"
    if path.is_file():
        return 0, path.read_text()
    _, failed, output = run_doctest(core.tests)
    return failed, output


def main() -> int:
    """Print the output of both cores' tests and corpora; returns the exit code."""
    root = cores.ROOT / "tests" / "conformance"
    corpora = {
        "wire": root / "wire",
        "payload": root / "scene" / "payload",
        "session": root / "session",
    }
    bad = 0
    for language in ("cpp",):
        missing = cores.missing_for(language)
        if missing is not None:
            sys.stdout.write(f"-- {language}: left out ({missing})\n")
            continue
        core = cores.cpp()
        client = Client(language, core)
        failed, output = unit_tests(core)
        sys.stdout.write(f"-- {language}: unit tests\n{output.strip()}\n")
        bad += failed
        for kind, folder in corpora.items():
            result = client.corpus(kind, folder)
            sys.stdout.write(f"-- {language}: {kind} corpus\n{result.output.strip()}\n")
            bad += result.failed
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
