"""The messages as a TypeScript module: types, field tables, limits and error codes.

The viewer's codec (``client_sdk/web/src/core/wire``) checks by these tables, so that it cannot
drift from the classes here. PURE: text out, no files; `terraport_wire.schema` writes it.
"""

from __future__ import annotations

import json
from typing import Any

from . import limits
from .codec import PROTOCOL, SUBPROTOCOL
from .errors import CLOSE_CODES
from .kinds import (
    Choice,
    Flag,
    Integer,
    Kind,
    Number,
    NumberMap,
    Position,
    Text,
    Version,
    VersionList,
)
from .message import Direction, Field, Message, Part, PartKind, PartList, fields_of
from .messages import MESSAGES, PARTS
from .tables import HeldTable, Ids, LoadTable

__all__ = ["messages_module"]

_HEAD = """\
// Written by `python -m terraport_wire.schema` from the message classes in Python; do not edit.

import type { SegmentFacts, Vec3 } from "../types.ts";
import type { FieldTable, HeldRow, MessageTable, Version } from "./kinds.ts";
"""


def messages_module() -> str:
    """Return the text of ``messages.generated.ts``; same classes, same text."""
    return "\n".join(
        [_HEAD, _constants(), *_interfaces(), *_unions(), _part_tables(), *_message_tables(), ""]
    )


def _constants() -> str:
    lines = [
        "/** Version of the protocol that this module speaks: major, minor. */",
        f"export const PROTOCOL: Version = [{PROTOCOL[0]}, {PROTOCOL[1]}];",
        "",
        "/** The WebSocket subprotocol: its name pins the major version. */",
        f"export const SUBPROTOCOL = {_json(SUBPROTOCOL)};",
        "",
        "/** Bounds that every speaker keeps (section 12); a server may be stricter. */",
        "export const LIMITS = {",
        *(f"  {name}: {_json(getattr(limits, name))}," for name in limits.__all__),
        "} as const;",
        "",
        "/** The close code of each error where it is fatal (section 11). */",
        "export const CLOSE_CODES = {",
        *(f"  {code.value}: {int(close)}," for code, close in CLOSE_CODES.items()),
        "} as const;",
        "",
        "/** Codes of the `error` message; one that is not here is treated by `fatal` alone. */",
        "export type ErrorCode = keyof typeof CLOSE_CODES;",
        "",
    ]
    return "\n".join(lines)


def _interfaces() -> list[str]:
    parts = [_interface(part, f"{part.__name__}Part", None) for part in PARTS]
    messages = [
        _interface(message, f"{message.__name__}Message", message.TYPE)
        for message in _all_messages()
    ]
    return parts + messages


def _interface(part: type[Part], name: str, type_name: str | None) -> str:
    lines = [f"/** {_comment(part.__doc__ or '')} */", f"export interface {name} {{"]
    if type_name is not None:
        lines.append(f"  readonly type: {_json(type_name)};")
    for field in fields_of(part):
        absent = "" if field.required else " | undefined"
        mark = "" if field.required else "?"
        lines.append(f"  /** {_comment(field.meaning)}. */")
        lines.append(f"  readonly {field.name}{mark}: {_type_of(field.kind)}{absent};")
    return "\n".join([*lines, "}", ""])


def _unions() -> list[str]:
    texts = []
    for name, direction in (
        ("ClientMessage", Direction.CLIENT_TO_SERVER),
        ("ServerMessage", Direction.SERVER_TO_CLIENT),
    ):
        members = [f"  | {message.__name__}Message" for message in MESSAGES[direction].values()]
        text = "/** Everything that is sent in one direction. */"
        texts.append("\n".join([text, f"export type {name} =", *members]) + ";\n")
    ruled = [message.TYPE for message in _all_messages() if _has_rule(message)]
    texts.append(
        "/** Messages with a rule between fields, which no table can say. */\n"
        f"export type MessageWithRule = {' | '.join(map(_json, ruled))};\n"
    )
    return texts


def _part_tables() -> str:
    rows = [f"  {part.wire_name()}: {_fields(part, '  ')}," for part in PARTS]
    return "\n".join(
        [
            "/** Fields of the maps that stand inside messages. */",
            "export const PARTS = {",
            *rows,
            "} as const satisfies Record<string, FieldTable>;",
            "",
        ]
    )


def _message_tables() -> list[str]:
    rows = []
    for direction, messages in MESSAGES.items():
        rows.append(f"  {direction.value}: {{")
        rows += [f"    {name}: {_fields(message, '    ')}," for name, message in messages.items()]
        rows.append("  },")
    return [
        "/** Fields of every message, by direction and type, in the order of writing. */",
        "export const MESSAGES: MessageTable = {",
        *rows,
        "};",
    ]


def _fields(part: type[Part], indent: str) -> str:
    lines = [f"{indent}  {_field(field)}," for field in fields_of(part)]
    return "\n".join(["[", *lines, f"{indent}]"]) if lines else "[]"


def _field(field: Field) -> str:
    required = _json(field.required)
    return f"{{ name: {_json(field.name)}, required: {required}, kind: {_kind(field.kind)} }}"


def _kind(kind: Kind) -> str:
    name, facts = _facts_of(kind)
    inner = "".join(f", {key}: {_json(value)}" for key, value in facts.items())
    return f"{{ name: {_json(name)}{inner} }}"


def _facts_of(kind: Kind) -> tuple[str, dict[str, Any]]:
    match kind:
        case Integer():
            return "integer", {"low": kind.low, "high": kind.high}
        case Number():
            bounds = {"low": kind.low, "high": kind.high}
            return "number", {**bounds, "lowExcluded": kind.low_excluded}
        case Flag():
            return "flag", {}
        case Text():
            lengths = {"shortest": kind.shortest, "longest": kind.longest}
            return "text", {**lengths, "pattern": kind.pattern}
        case Choice():
            return "choice", {"options": list(kind.options)}
        case Position():
            return "position", {"bound": kind.bound, "nonzero": kind.nonzero}
        case Version():
            return "version", {}
        case VersionList():
            return "versions", {"most": kind.most}
        case NumberMap():
            return "numbers", {"most": kind.most}
        case Ids():
            return "ids", {"most": kind.most}
        case HeldTable():
            return "held", {"most": kind.most}
        case LoadTable():
            return "load", {"most": kind.most}
        case PartKind():
            return "part", {"part": kind.part.wire_name()}
        case PartList():
            return "parts", {"part": kind.part.wire_name(), "most": kind.most}
    raise TypeError(f"no TypeScript for {type(kind).__name__}")


def _type_of(kind: Kind) -> str:
    match kind:
        case Integer() | Number():
            return "number"
        case Flag():
            return "boolean"
        case Text():
            return "string"
        case Choice():
            return " | ".join(map(_json, kind.options))
        case Position():
            return "Vec3"
        case Version():
            return "Version"
        case VersionList():
            return "readonly Version[]"
        case NumberMap():
            return "Readonly<Record<string, number>>"
        case Ids():
            return "readonly number[]"
        case HeldTable():
            return "readonly HeldRow[]"
        case LoadTable():
            return "readonly SegmentFacts[]"
        case PartKind():
            return f"{kind.part.__name__}Part"
        case PartList():
            return f"readonly {kind.part.__name__}Part[]"
    raise TypeError(f"no TypeScript for {type(kind).__name__}")


def _has_rule(message: type[Message]) -> bool:
    return message.contradiction is not Part.contradiction


def _all_messages() -> list[type[Message]]:
    return [message for by_type in MESSAGES.values() for message in by_type.values()]


def _comment(text: str) -> str:
    return " ".join(text.split()).replace("*/", "* /")


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)
