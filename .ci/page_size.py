"""Sizes of the built viewer, as browsers load it, against a budget.

What a visitor waits for is the brotli form of the page, its style and the scripts; pictures and
licences do not count. Exit code 1: over the budget, or no page.
"""

from __future__ import annotations

import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "server" / "terraport_server" / "page"
BUDGET_BYTES = 300_000
"""Brotli, everything together; 258,000 when it was set. A second on 4G."""
COUNTED = {".css", ".html", ".js"}


def main() -> int:
    """Print the table; compare the sum."""
    files = sorted(path for path in PAGE.rglob("*") if path.suffix in COUNTED)
    if not files:
        print(f"page: nothing built at {PAGE}")
        return 1
    total = 0
    print(f"{'file':44}{'bytes':>10}{'gzip':>10}{'brotli':>10}")
    for path in files:
        plain = path.stat().st_size
        gzip, brotli = (_twin(path, ending) for ending in (".gz", ".br"))
        total += brotli
        print(f"{path.relative_to(PAGE).as_posix():44}{plain:>10,}{gzip:>10,}{brotli:>10,}")
    print(f"page: {total:,} bytes with brotli, at most {BUDGET_BYTES:,}")
    return int(total > BUDGET_BYTES)


def _twin(path: Path, ending: str) -> int:
    twin = path.with_name(path.name + ending)
    return (twin if twin.is_file() else path).stat().st_size


if __name__ == "__main__":
    sys.exit(main())
