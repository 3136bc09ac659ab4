"""Kernels compiled ahead, in a process of low priority beside the first run.

Each of ``kernels.txt`` is one that ``terraport demo`` calls, with the types of its arguments, in
the order in which a run calls them. numba keeps what it has compiled in files, so what the child
has compiled the run only loads. The child goes from the last kernel backwards: it and the run meet
once, in the middle. (Forwards, both would come to each kernel at the same time and compile it
twice.) A kernel that the list lacks, or has too much, costs time and nothing else;
``benchmarks/kernels.py`` writes it.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numba
import numpy as np
from numba.core.errors import NumbaError

from terraport_pipeline.engines.poisson_child import die_with_parent

__all__ = ["KERNELS", "kernel_of", "read_kernels", "type_of", "warm", "warming"]

KERNELS: Final = Path(__file__).with_name("kernels.txt")
"""A kernel on each line, below this package: its name, then the types of its arguments."""

_PACKAGE: Final = "terraport_pipeline"

_TYPE: Final = re.compile(r"(?P<item>\w+)(?::(?P<ndim>\d)(?P<readonly>r?)|\((?P<fields>.*)\))?")
"""``f8`` a scalar, ``f8:2`` an array of two axes (C order), ``f8:2r`` a read-only one,
``Grid(f8,i8)`` a named tuple of the kernel's module."""


@contextlib.contextmanager
def warming() -> Iterator[None]:
    """Compile kernels beside the block, where a second core is there for it."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    if (cores or 1) < 2:
        yield
        return
    child = subprocess.Popen(
        [sys.executable, "-m", "terraport_pipeline.warm", str(os.getpid())],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        child.kill()
        child.wait()


def read_kernels() -> list[tuple[str, list[str]]]:
    """Return the name and the types of each kernel of the list, in the order of the calls."""
    rows = (line.split() for line in KERNELS.read_text(encoding="utf-8").splitlines())
    return [(name, types) for name, *types in rows]


def kernel_of(name: str) -> tuple[Any, dict[str, Any]]:
    """Return a kernel by its name below the package, and the names that its module knows."""
    module_name, _, attribute = name.rpartition(".")
    names = vars(importlib.import_module(f"{_PACKAGE}.{module_name}"))
    return names[attribute], names


def type_of(text: str, names: dict[str, Any]) -> Any:
    """Return numba's type for one of the list; `names` are those of the kernel's module.

    Examples
    --------
    >>> type_of("f8", {}), type_of("i4:2r", {})
    (float64, Array(int32, 2, 'C', True, aligned=True))
    """
    match = _TYPE.fullmatch(text)
    if match is None:
        raise ValueError(f"received {text!r}, expected a type as f8, f8:2, f8:2r or Grid(f8,i8)")
    if match["fields"] is not None:
        fields = [type_of(field, names) for field in match["fields"].split(",")]
        return numba.types.NamedTuple(fields, names[match["item"]])  # type: ignore[no-untyped-call]
    item = numba.from_dtype(np.dtype(match["item"]))
    if match["ndim"] is None:
        return item
    return numba.types.Array(item, int(match["ndim"]), "C", readonly=bool(match["readonly"]))


def warm(kernels: list[tuple[str, list[str]]]) -> None:
    """Compile kernels, the last first; ends at once where the last is compiled already."""
    for index, (name, types) in enumerate(reversed(kernels)):
        # Of a list older than the kernels: the run compiles it as it comes to it.
        with contextlib.suppress(
            NumbaError, ImportError, AttributeError, KeyError, TypeError, RuntimeError
        ):
            kernel, names = kernel_of(name)
            kernel.compile(tuple(type_of(text, names) for text in types))
            if index == 0 and kernel.stats.cache_hits:
                return


if __name__ == "__main__":
    die_with_parent(int(sys.argv[1]))
    if hasattr(os, "nice"):
        os.nice(10)
    warm(read_kernels())
