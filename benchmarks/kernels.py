"""Seconds that each kernel of the first run takes to compile: ``python benchmarks/kernels.py``.

The list of these kernels (:mod:`terraport_pipeline.warm`) is written from a cache that a cold run
filled, on one core: with two a child compiles beside the run, and the order is not that of calls::

    NUMBA_CACHE_DIR=/tmp/cold taskset -c 0 terraport demo --no-serve
    python benchmarks/kernels.py --write /tmp/cold
"""

from __future__ import annotations

import argparse
import os
import pickle
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

PACKAGE = "terraport_pipeline"


def main() -> None:
    """Print the table, or write the list."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, metavar="CACHE", help="cache of a cold run")
    parser.add_argument("--smoke", action="store_true", help="the first three")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as cold:
        os.environ["NUMBA_CACHE_DIR"] = cold  # before numba reads it
        from terraport_pipeline.warm import KERNELS, kernel_of, read_kernels, type_of

        if options.write:
            KERNELS.write_text(
                "\n".join(dict.fromkeys(calls_of(options.write))) + "\n", encoding="utf-8"
            )
            return
        rows = []
        for name, types in read_kernels()[: 3 if options.smoke else None]:
            kernel, names = kernel_of(name)
            start = time.process_time()
            kernel.compile(tuple(type_of(text, names) for text in types))
            rows.append((time.process_time() - start, name))
    # What is called from several kernels is counted with the first of them.
    times = Counter(name for _, name in rows)
    table = Table("kernel", "signatures", "CPU s")
    for seconds, name in sorted(rows, reverse=True):
        table.add_row(name, str(times[name]), f"{seconds:.2f}")
    table.add_row("all", str(len(rows)), f"{sum(seconds for seconds, _ in rows):.1f}")
    Console().print(table)


def calls_of(cache: Path) -> Iterator[str]:
    """Lines of the list: what a cache holds, in the order in which it came."""
    import terraport_pipeline

    package = Path(terraport_pipeline.__file__).parent
    module_of = {
        (file.parent.name, file.stem): ".".join(file.relative_to(package).with_suffix("").parts)
        for file in package.rglob("*.py")
    }
    lines: list[tuple[int, str]] = []
    for index in cache.rglob("*.nbi"):
        # numba's own layout: folder_hash/module.function-line.py311.nbi
        folder = index.parent.name.rpartition("_")[0]
        module, _, function = index.name.rpartition("-")[0].partition(".")
        with index.open("rb") as file:
            pickle.load(file)  # numba's version
            _, overloads = pickle.loads(file.read())
        for (types, *_), data in overloads.items():
            words = [text_of(one) for one in types]
            if (folder, module) in module_of and None not in words:
                moment = index.with_name(data).stat().st_mtime_ns
                name = f"{module_of[folder, module]}.{function}"
                lines.append((moment, " ".join([name, *map(str, words)])))
    return (line for _, line in sorted(lines))


def text_of(one: Any) -> str | None:
    """Write a type as :func:`terraport_pipeline.warm.type_of` reads it.

    None for what only a kernel gives to another: that comes with the other.
    """
    from numba.core import types
    from numba.np.numpy_support import as_dtype

    if isinstance(one, types.NamedTuple | types.NamedUniTuple):
        fields = [text_of(field) for field in one.types]
        inner = ",".join(str(field) for field in fields)
        return None if None in fields else f"{one.instance_class.__name__}({inner})"
    if isinstance(one, types.Array):
        flags = "" if one.mutable else "r"
        return f"{as_dtype(one.dtype).str[1:]}:{one.ndim}{flags}" if one.layout == "C" else None
    if isinstance(one, types.Boolean | types.Number):
        return str(as_dtype(one).str[1:])
    return None


if __name__ == "__main__":
    main()
