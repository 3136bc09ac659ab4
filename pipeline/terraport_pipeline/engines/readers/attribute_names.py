"""Attribute names that stay distinct when they are written as glTF names.

PURE.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Final

from terraport_payload import gltf_attribute_name

__all__ = ["distinct_names"]

_RESERVED: Final = "_FEATURE_ID_"
"""Prefix of the names that hold region numbers (EXT_mesh_features)."""


def distinct_names(names: Iterable[str]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Rename attributes whose glTF names would be the same.

    glTF names are in capitals, with ``_`` for everything but letters and digits: ``intensity`` and
    ``Intensity`` become the same name, and so do ``a b`` and ``a_b``.

    Parameters
    ----------
    names : iterable of str
        All different. The first of those with the same glTF name keeps its own.

    Returns
    -------
    renamed : dict of str to str
        New name of every attribute, in the given order.
    warnings : tuple of str
        One sentence for each name that changes.

    Examples
    --------
    >>> distinct_names(["intensity", "Intensity", "Intensity_2"])[0]
    {'intensity': 'intensity', 'Intensity': 'Intensity_3', 'Intensity_2': 'Intensity_2'}
    """
    names = list(names)
    first: dict[str, str] = {}
    for name in names:
        if not gltf_attribute_name(name).startswith(_RESERVED):
            first.setdefault(gltf_attribute_name(name), name)
    taken = set(first)
    renamed: dict[str, str] = {}
    warnings = []
    for name in names:
        own = gltf_attribute_name(name)
        other = first.get(own)
        renamed[name] = name
        if other == name:
            continue
        stem = name if other is not None else f"survey_{name}"
        numbered = (f"{stem}_{number}" for number in itertools.count(2))
        candidates = numbered if other is not None else itertools.chain([stem], numbered)
        new = next(one for one in candidates if gltf_attribute_name(one) not in taken)
        taken.add(gltf_attribute_name(new))
        renamed[name] = new
        reason = "is reserved" if other is None else f"is also that of {other!r}"
        warnings.append(
            f"Attribute {name!r} is called {new!r} in the scene: its name in glTF ({own}) {reason}."
        )
    return renamed, tuple(warnings)
