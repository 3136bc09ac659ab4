"""Pack a Godot project as a .pck file, as its exporter would (pack format 3, Godot 4.5 or later).

The exporter needs the editor, which no package registry has. Scripts, scenes and shaders stay text:
the engine reads them so.
"""

from __future__ import annotations

import hashlib
import re
import struct
from collections.abc import Mapping
from typing import Final

__all__ = ["pack"]

_HEADER: Final = struct.Struct("<4s5IQQ")
_HEADER_BYTES: Final = 112
_OFFSETS_FROM_HERE: Final = 2
_ALIGNMENT: Final = 16
_CLASSES: Final = ".godot/global_script_class_cache.cfg"
"""Where the editor lists scripts with a ``class_name``; the engine does not look for them."""


def pack(files: Mapping[str, bytes]) -> bytes:
    """Return a .pck file.

    Parameters
    ----------
    files : mapping of str to bytes
        Contents by path below ``res://``.
    """
    body, entries = bytearray(), []
    for path, content in {**files, _CLASSES: _class_list(files)}.items():
        name = path.encode()
        entries.append(
            struct.pack("<I", len(name) + -len(name) % 4)
            + name.ljust(len(name) + -len(name) % 4, b"\0")
            + struct.pack("<QQ", len(body), len(content))
            + hashlib.md5(content, usedforsecurity=False).digest()
            + struct.pack("<I", 0)
        )
        body += content + bytes(-len(content) % _ALIGNMENT)
    header = _HEADER.pack(
        b"GDPC", 3, 4, 6, 0, _OFFSETS_FROM_HERE, _HEADER_BYTES, _HEADER_BYTES + len(body)
    )
    directory = struct.pack("<I", len(entries)) + b"".join(entries)
    return header.ljust(_HEADER_BYTES, b"\0") + bytes(body) + directory


def _class_list(files: Mapping[str, bytes]) -> bytes:
    classes = []
    for path, content in files.items():
        name = re.search(rb"^class_name (\w+)", content, re.MULTILINE)
        base = re.search(rb"^extends (\w+)", content, re.MULTILINE)
        if path.endswith(".gd") and name and base:
            classes.append(
                f'{{"base": &"{base[1].decode()}", "class": &"{name[1].decode()}", "icon": "", '
                f'"is_abstract": false, "is_tool": false, "language": &"GDScript", '
                f'"path": "res://{path}"}}'
            )
    return f"list=[{', '.join(classes)}]\n".encode()
