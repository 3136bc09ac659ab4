"""Addresses told from paths, also where somebody has taken one for the other.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import re
from pathlib import PurePath

__all__ = ["is_url", "meant_url"]

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")

_COLLAPSED = re.compile(r"(s3a?|gs|az|https?):/?(?!/)(.*)", re.DOTALL)
"""What a path makes of an address: two slashes are one."""


def is_url(location: str | PurePath) -> bool:
    """Tell an address (``s3://bucket/scene``) from a path.

    Examples
    --------
    >>> is_url("s3://bucket/scene"), is_url("scenes/quarry"), is_url("C://x")
    (True, False, False)
    """
    return isinstance(location, str) and _URL.match(location) is not None


def meant_url(location: str | PurePath) -> str | None:
    """Return the address that was perhaps meant by what is a path; None for any other path.

    Examples
    --------
    >>> meant_url("s3:/bucket/scene"), meant_url(PurePath("s3://bucket/scene"))
    ('s3://bucket/scene', 's3://bucket/scene')
    >>> meant_url("scenes/quarry"), meant_url("s3://bucket/scene")
    (None, None)
    """
    collapsed = _COLLAPSED.fullmatch(str(location))
    return None if collapsed is None else f"{collapsed[1]}://{collapsed[2]}"
