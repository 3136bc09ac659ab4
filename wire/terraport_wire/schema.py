"""JSON Schema of every message, and the field tables of the specification.

``python -m terraport_wire.schema SPEC_DIR`` writes ``SPEC_DIR/schema/*.json`` and the tables
between the ``generated`` marks of ``SPEC_DIR/wire-protocol.md``; with ``--typescript FILE`` also
the viewer's tables (`terraport_wire.typescript`); ``--check`` only compares.  The functions are
pure; `main` alone touches files.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .errors import CLOSE_CODES, HTTP_STATUS
from .message import Direction, Message, Part, fields_of, part_schema
from .messages import MESSAGES, PARTS
from .typescript import messages_module

__all__ = ["error_table", "field_table", "main", "message_schema", "render_spec", "schema_files"]

_DRAFT = "https://json-schema.org/draft/2020-12/schema"
_BASE = "https://terraport.invalid/schema/v1"
_Files = dict[Path, str]

# What else is generated where a path is given for it: flag, what the path is, meaning, the files.
_LANGUAGES: dict[str, tuple[str, str, Callable[[Path], _Files]]] = {
    "typescript": ("FILE", "the viewer's tables", lambda path: {path: messages_module()}),
}
_MARK = re.compile(r"(<!-- generated: (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)


def message_schema(message: type[Message]) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a message's readable form.

    That is the map with tables as lists of rows, as the corpus states it (section 15); what stands
    on the wire in the place of each is its ``x-msgpack``.

    Unknown keys are allowed, null stands for absent.  Relations between fields (sums, disjoint
    ids, ids once in a table) are beyond JSON Schema; the specification states them.
    """
    return {
        "$schema": _DRAFT,
        "$id": f"{_BASE}/{message.TYPE}.json",
        "title": message.TYPE,
        "description": (message.__doc__ or "").strip(),
        "x-direction": message.DIRECTION.value,
        **part_schema(message, type_name=message.TYPE),
    }


def schema_files() -> dict[str, str]:
    """Return file name -> text of all schema files: one per message, one per direction."""
    files: dict[str, str] = {}
    for direction, messages in MESSAGES.items():
        references = [{"$ref": f"{_BASE}/{name}.json"} for name in messages]
        whole = {
            "$schema": _DRAFT,
            "$id": f"{_BASE}/{direction.value}.json",
            "title": f"messages {direction.value.replace('_', ' ')}",
            "oneOf": references,
        }
        files[f"{direction.value}.json"] = _text(whole)
        for name, message in messages.items():
            files[f"{name}.json"] = _text(message_schema(message))
    return files


def field_table(part: type[Part]) -> str:
    """Return the Markdown table of a message's or part's fields."""
    rows = ["| field | type | | meaning |", "|---|---|---|---|"]
    for field in fields_of(part):
        presence = "required" if field.required else "optional"
        rows.append(f"| `{field.name}` | {field.kind.describe()} | {presence} | {field.meaning} |")
    return "\n".join(rows) if len(rows) > 2 else "No fields."


def error_table() -> str:
    """Return the Markdown table of error codes and close codes."""
    rows = ["| code | close code | HTTP |", "|---|---|---|"]
    for code, close in CLOSE_CODES.items():
        rows.append(f"| `{code.value}` | {int(close)} | {HTTP_STATUS[close]} |")
    return "\n".join(rows)


def render_spec(text: str) -> str:
    """Return the specification with every generated part written anew.

    Raises
    ------
    KeyError
        If a mark names no message, no part and no table.
    """
    tables = {name: _message_part(message) for name, message in _all_messages().items()}
    tables |= {part.wire_name(): field_table(part) for part in PARTS}
    tables["error-codes"] = error_table()
    return _MARK.sub(lambda mark: f"{mark[1]}\n{tables[mark[2]]}\n\n{mark[3]}", text)


def main(arguments: list[str] | None = None) -> int:
    """Write or check the generated files; return the process's exit code."""
    parser = argparse.ArgumentParser(prog="python -m terraport_wire.schema", description=__doc__)
    parser.add_argument("spec_dir", type=Path, help="the folder spec/")
    for flag, (path_is, meaning, _) in _LANGUAGES.items():
        parser.add_argument(f"--{flag}", type=Path, metavar=path_is, help=meaning)
    parser.add_argument("--check", action="store_true", help="only compare; exit 1 if any differs")
    options = parser.parse_args(arguments)
    spec = options.spec_dir / "wire-protocol.md"
    expected = {options.spec_dir / "schema" / name: text for name, text in schema_files().items()}
    expected[spec] = render_spec(spec.read_text(encoding="utf-8"))
    for flag, (_, _, files) in _LANGUAGES.items():
        destination: Path | None = getattr(options, flag)
        if destination is not None:
            expected |= files(destination)
    stale = [
        path
        for path, text in expected.items()
        if not path.is_file() or path.read_text(encoding="utf-8") != text
    ]
    for path in stale:
        if options.check:
            sys.stderr.write(f"error: {path} is not what terraport_wire.schema generates\n")
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(expected[path], encoding="utf-8")
    return 1 if options.check and stale else 0


def _all_messages() -> dict[str, type[Message]]:
    return {name: message for by_type in MESSAGES.values() for name, message in by_type.items()}


def _message_part(message: type[Message]) -> str:
    sender = "client" if message.DIRECTION is Direction.CLIENT_TO_SERVER else "server"
    return f"*Sent by the {sender}.* {(message.__doc__ or '').strip()}\n\n{field_table(message)}"


def _text(schema: dict[str, Any]) -> str:
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    sys.exit(main())
