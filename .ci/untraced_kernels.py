"""A pytest plugin for measuring coverage: kernels are compiled without it.

numba compiles in Python, and coverage's tracer is called for each line of any Python: compiling
the kernels took twice as long with it (28.7 and 54.0 s of CPU for tests of one module).
"""

from __future__ import annotations

import functools
import sys
from typing import Any

from numba.core.dispatcher import Dispatcher


def pytest_configure() -> None:
    """Stop tracing while a kernel is compiled."""
    compile_kernel = Dispatcher.compile

    @functools.wraps(compile_kernel)
    def untraced(self: Dispatcher, signature: Any) -> Any:
        tracer = sys.gettrace()
        sys.settrace(None)
        try:
            return compile_kernel(self, signature)
        finally:
            sys.settrace(tracer)

    Dispatcher.compile = untraced
