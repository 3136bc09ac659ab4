"""Print which lines of the product the tests ran: a line a package, and each module below 80 %.

Reads the data that pytest-cov left (``.coverage``). Python only, in the tests' own processes: what
numba compiles, and what a service or a build in a process of its own runs, counts as not run.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

LEAST_PERCENT = 80.0
ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    """Print the table; never fails for a figure."""
    import coverage

    data = coverage.Coverage(config_file=str(ROOT / "pyproject.toml"))
    data.load()
    modules = []
    for path in sorted(data.get_data().measured_files()):
        _, statements, _, missing, _ = data.analysis2(path)
        modules.append((Path(path).relative_to(ROOT).as_posix(), len(statements), len(missing)))
    print("\n".join(table(modules)))
    return 0


def table(modules: Iterable[tuple[str, int, int]]) -> list[str]:
    """Make the lines of the table.

    Parameters
    ----------
    modules : Iterable[tuple[str, int, int]]
        Path, executable lines, and how many of them no test ran.
    """
    packages: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0])
    below = []
    for path, lines, missing in modules:
        package = next(folder for folder in path.split("/") if folder.startswith("terraport"))
        sums = packages[package]
        sums[0] += 1
        sums[1] += lines
        sums[2] += missing
        if percent(lines, missing) < LEAST_PERCENT:
            below.append((percent(lines, missing), missing, path))
    rows = [f"coverage: {'package':22}{'modules':>9}{'lines':>9}{'run':>8}"]
    for package, (count, lines, missing) in sorted(packages.items()):
        rows.append(f"          {package:22}{count:>9}{lines:>9,}{percent(lines, missing):>6.1f} %")
    rows.append(f"coverage: {len(below)} modules below {LEAST_PERCENT:.0f} %")
    rows += [
        f"  {share:5.1f} %  {missing:4} lines not run  {path}"
        for share, missing, path in sorted(below)
    ]
    return rows


def percent(lines: int, missing: int) -> float:
    """Share of the lines that ran; an empty module is whole."""
    return 100.0 * (lines - missing) / lines if lines else 100.0


if __name__ == "__main__":
    sys.exit(main())
