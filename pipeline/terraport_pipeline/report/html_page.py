"""What the HTML pages share: how templates are read, and how a page replaces the old one."""

from __future__ import annotations

import base64
import os
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from terraport_pipeline.option import format_bytes

__all__ = ["page_templates", "replace_bytes", "replace_page"]


def page_templates(package: str) -> Environment:
    """Open the templates of a package.

    Parameters
    ----------
    package : str
        Dotted name; its folder ``templates`` holds them.

    Returns
    -------
    Environment
        Escapes what it inserts, refuses names that nobody gave, and knows the filters ``base64``
        (of bytes), ``bytes`` (amounts with a unit) and ``amount`` (whole numbers with commas).
    """
    environment = Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["base64"] = lambda data: base64.b64encode(data).decode("ascii")
    environment.filters["bytes"] = format_bytes
    environment.filters["amount"] = lambda value: f"{value:,.0f}"
    return environment


def replace_page(path: Path, page: str) -> int:
    """Write beside the target and rename: a reader sees the old page or the new one.

    Parameters
    ----------
    path : Path
    page : str
        Written as UTF-8, with line feeds as they are.

    Returns
    -------
    int
        Bytes written.

    Raises
    ------
    OSError
        The page cannot be written; nothing is left beside it.
    """
    return replace_bytes(path, page.encode())


def replace_bytes(path: Path, data: bytes) -> int:
    """Write any file in the same way; see :func:`replace_page`."""
    draft = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        size = draft.write_bytes(data)
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
    return size
