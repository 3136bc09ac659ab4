"""What a command says where a package of another extra is missing."""

from __future__ import annotations

from importlib.util import find_spec

from terraport_pipeline.errors import OptionError

__all__ = ["require_drawings", "require_learning"]


def require_drawings(what: str) -> None:
    """Check that files of GIS and CAD can be read."""
    _require(what, ("pyogrio", "shapely"), "export")


def require_learning(what: str) -> None:
    """Check that a forest can be grown."""
    _require(what, ("sklearn",), "teach")


def _require(what: str, packages: tuple[str, ...], extra: str) -> None:
    for package in packages:
        if find_spec(package) is None:
            raise OptionError(f'{what} needs {package}: install "terraport[{extra}]"')
