"""The version of the installed distribution.

Kept in the package's metadata alone, so that there is one place to change it.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

__all__ = ["__version__"]


def _read() -> str:
    try:
        return version("terraport")
    except PackageNotFoundError:
        return "0+unknown"  # run from a source tree that is not installed


__version__ = _read()
