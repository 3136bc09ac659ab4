"""The metrics of several worker processes as one page, as if one process had counted them all.

Each worker counts for itself; its page in Prometheus' text format is what it hands over. Counters,
histograms and gauges are added up sample by sample, so a series has the same name and labels with
one worker as with many. What a worker had counted when it ended stays in the sums: a counter that
fell would look like a restart of the service to whoever computes rates.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

__all__ = ["EndedWorkers", "merge_pages"]

_LARGEST: Final = ("_info", "_max", "_timestamp_seconds", "_start_time_seconds")
"""Gauges of which the largest says it all; a sum of them would say nothing."""
_SMALLEST: Final = ("_created",)
"""The moment that a counter began."""
_ADDED_UP: Final = frozenset({"counter", "histogram", "summary"})


@dataclass(slots=True)
class _Family:
    """One metric: what its lines say about it, and its samples by name and labels as written."""

    help_line: str = ""
    kind: str = "untyped"
    samples: dict[str, float] = field(default_factory=dict)


class EndedWorkers:
    """What workers that are gone had counted. Bounded: one number per series, however many end."""

    def __init__(self) -> None:
        self._families: dict[str, _Family] = {}

    def add(self, page: str) -> None:
        """Keep the counters and histograms of the last page of a worker; its gauges are over."""
        counted = {name: family for name, family in _read(page).items() if family.kind in _ADDED_UP}
        _add(self._families, counted)

    def merged_with(self, pages: Iterable[str]) -> str:
        """Return one page of what is kept and of the pages of the workers that live."""
        families = {
            name: _Family(family.help_line, family.kind, dict(family.samples))
            for name, family in self._families.items()
        }
        for page in pages:
            _add(families, _read(page))
        return _write(families)


def merge_pages(pages: Iterable[str]) -> str:
    r"""Return one page of the pages of several workers.

    Examples
    --------
    >>> page = "# HELP a_total A.\n# TYPE a_total counter\na_total{x=\"1\"} 2.0\n"
    >>> print(merge_pages([page, page]), end="")
    # HELP a_total A.
    # TYPE a_total counter
    a_total{x="1"} 4.0
    """
    return EndedWorkers().merged_with(pages)


def _read(page: str) -> dict[str, _Family]:
    """Take a page apart; families in their order. Lines that are no samples are left out."""
    families: dict[str, _Family] = {}
    current = _Family()
    for line in page.splitlines():
        if line.startswith("# HELP "):
            current = families.setdefault(line.split(" ", 3)[2], _Family())
            current.help_line = line
        elif line.startswith("# TYPE "):
            _, _, name, kind = line.split(" ", 3)
            current = families.setdefault(name, _Family())
            current.kind = kind.strip()
        elif line and not line.startswith("#"):
            series, _, text = line.rpartition(" ")
            current.samples[series] = float(text)
    return families


def _add(families: dict[str, _Family], more: dict[str, _Family]) -> None:
    for name, added in more.items():
        family = families.setdefault(name, _Family(added.help_line, added.kind))
        for series, value in added.samples.items():
            before = family.samples.get(series)
            if before is None:
                family.samples[series] = value
            elif name.endswith(_LARGEST):
                family.samples[series] = max(before, value)
            elif name.endswith(_SMALLEST):
                family.samples[series] = min(before, value)
            else:
                family.samples[series] = before + value


def _write(families: dict[str, _Family]) -> str:
    lines: list[str] = []
    for name, family in families.items():
        if family.help_line:
            lines.append(family.help_line)
        lines.append(f"# TYPE {name} {family.kind}")
        lines.extend(f"{series} {value!r}" for series, value in family.samples.items())
    return "".join(f"{line}\n" for line in lines)
