"""What a token lets its bearer do, beside which scenes it opens.

=========== ================================================================================
scope       lets
=========== ================================================================================
``land``    see its scenes: their list, files and segments over HTTP, landings
``guide``   move a group (settings page, ``group_guides``), and what ``land`` lets
``teach``   paint strokes that teach a scene names, and what ``land`` lets
``metrics`` read ``/metrics``, and nothing of any scene
=========== ================================================================================

A token that says nothing of scopes may land. Uploading and building are not the service's: they ask
for keys of the object storage, or for the folder.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal, get_args

__all__ = ["EVERYTHING", "LAND", "SCOPES", "Scope", "scopes_of"]

Scope = Literal["land", "guide", "teach", "metrics"]

SCOPES: Final[tuple[Scope, ...]] = get_args(Scope)
LAND: Final[frozenset[Scope]] = frozenset({"land"})
"""Of a token that names none."""
EVERYTHING: Final[frozenset[Scope]] = frozenset(SCOPES)


def scopes_of(words: Iterable[str]) -> frozenset[Scope]:
    """Return the scopes that words name; others are passed over.

    Examples
    --------
    >>> sorted(scopes_of(["guide"])), sorted(scopes_of(["metrics", "email"]))
    (['guide', 'land'], ['metrics'])
    """
    named = set(words)
    scopes: frozenset[Scope] = frozenset(scope for scope in SCOPES if scope in named)
    return scopes | LAND if scopes & {"guide", "teach"} else scopes
