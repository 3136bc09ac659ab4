"""The messages as C++ structs, and the fields of each as a function: the Unreal client's tables.

Its codec (``client_sdk/unreal/Source/TerraportCore/Private/Wire*``) reads, checks and writes by
these functions, so that it cannot drift from the classes here; no tables of offsets, no run-time
type information. PURE: text out, no files; `terraport_wire.schema` writes it.
"""

from __future__ import annotations

import json

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

__all__ = ["cpp_files"]

_WRITTEN = "// Written by `python -m terraport_wire.schema` from the message classes in Python; "
_INCLUDES = """\
#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>"""
_FIELDS_OF = """\
/// The fields of a message or part, in the order of writing: `visitor.field(name, value, kind)`
/// for each, until one returns false.
template <typename Message>
struct FieldsOf;"""
_UINT_MOST = 2**32 - 1

# The core has no regular expressions: WireChecks.cpp knows these.
_PATTERNS = {
    None: "Any",
    "[A-Za-z0-9_.~-]+": "GroupName",
    "[a-z][a-z0-9_]*": "Word",
}


def cpp_files() -> dict[str, str]:
    """Return file name -> text of the generated headers; same classes, same text."""
    return {
        "Messages.generated.h": _messages_header(),
        "MessageFields.generated.h": _fields_header(),
    }


def _messages_header() -> str:
    structs = [_struct(part, f"{part.__name__}Part") for part in PARTS]
    structs += [_struct(message, f"{message.__name__}Message") for message in _all_messages()]
    return "\n\n".join(
        [
            _WRITTEN + "do not edit.",
            "#pragma once",
            '#include "WireKinds.h"',
            _INCLUDES,
            "namespace terraport {",
            _constants(),
            _close_codes(),
            *structs,
            *_variants(),
            "}  // namespace terraport\n",
        ]
    )


def _fields_header() -> str:
    parts = [_visit(part, f"{part.__name__}Part", part.wire_name()) for part in PARTS]
    messages = [
        _visit(message, f"{message.__name__}Message", message.TYPE) for message in _all_messages()
    ]
    return "\n\n".join(
        [
            _WRITTEN + "do not edit.",
            "#pragma once",
            '#include "Messages.generated.h"',
            "namespace terraport {",
            _FIELDS_OF,
            *parts,
            *messages,
            "}  // namespace terraport\n",
        ]
    )


def _constants() -> str:
    return "\n".join(
        [
            "/// Version of the protocol that this client speaks.",
            f"constexpr ProtocolVersion kProtocol{{{PROTOCOL[0]}, {PROTOCOL[1]}}};",
            "",
            "/// The WebSocket subprotocol: its name pins the major version.",
            f"constexpr const char* kSubprotocol = {json.dumps(SUBPROTOCOL)};",
            "",
            "/// Bounds that every speaker keeps (section 12); a server may be stricter.",
            "namespace limits {",
            *(_limit(name, getattr(limits, name)) for name in limits.__all__),
            "}  // namespace limits",
        ]
    )


def _limit(name: str, value: float) -> str:
    type_name = "double" if isinstance(value, float) else "std::uint64_t"
    return f"constexpr {type_name} k{''.join(map(str.capitalize, name.split('_')))} = {value!r};"


def _close_codes() -> str:
    rows = [f'    {{"{code.value}", {int(close)}}},' for code, close in CLOSE_CODES.items()]
    return "\n".join(
        [
            "/// An error code, and the close code where it is fatal (section 11).",
            "struct CloseCodeRow {\n  const char* error;\n  int closeCode;\n};",
            "",
            "constexpr CloseCodeRow kCloseCodes[] = {",
            *rows,
            "};",
        ]
    )


def _struct(part: type[Part], name: str) -> str:
    lines = [f"/// {_comment(part.__doc__ or '')}", f"struct {name} {{"]
    for field in fields_of(part):
        type_name, start = _type_of(field.kind)
        lines.append(f"  /// {_comment(field.meaning)}.")
        if field.required:
            lines.append(f"  {type_name} {_camel(field.name)}{start};")
        else:
            lines.append(f"  std::optional<{type_name}> {_camel(field.name)};")
    return "\n".join([*lines, "};"])


def _variants() -> list[str]:
    texts = []
    for name, direction in (
        ("ClientMessage", Direction.CLIENT_TO_SERVER),
        ("ServerMessage", Direction.SERVER_TO_CLIENT),
    ):
        members = ["UnknownMessage"]
        members += [f"{message.__name__}Message" for message in MESSAGES[direction].values()]
        inner = ",\n    ".join(members)
        texts.append(
            "/// Everything that is sent in one direction.\n"
            f"using {name} = std::variant<\n    {inner}>;"
        )
    return texts


def _visit(part: type[Part], name: str, wire_name: str) -> str:
    lines = [
        "template <>",
        f"struct FieldsOf<{name}> {{",
        f"  static constexpr const char* kType = {json.dumps(wire_name)};",
    ]
    fields = fields_of(part)
    if not fields:
        lines += [
            "  template <typename Visitor, typename Message>",
            "  static bool visit(Visitor&, Message&) {",
            "    return true;",
        ]
    else:
        calls = " &&\n           ".join(map(_call, fields))
        lines += [
            "  template <typename Visitor, typename Message>",
            "  static bool visit(Visitor& visitor, Message& message) {",
            f"    return {calls};",
        ]
    return "\n".join([*lines, "  }", "};"])


def _call(field: Field) -> str:
    member = _camel(field.name)
    return f"visitor.field({json.dumps(field.name)}, message.{member}, {_kind(field.kind)})"


def _kind(kind: Kind) -> str:
    match kind:
        case Integer():
            return f"IntegerKind{{{kind.low}, {kind.high}}}"
        case Number():
            excluded = "true" if kind.low_excluded else "false"
            return f"NumberKind{{{float(kind.low)!r}, {float(kind.high)!r}, {excluded}}}"
        case Flag():
            return "FlagKind{}"
        case Text():
            if kind.pattern not in _PATTERNS:
                raise TypeError(f"no C++ for the pattern {kind.pattern}; add it to WireChecks.cpp")
            pattern = f"TextPattern::{_PATTERNS[kind.pattern]}"
            return f"TextKind{{{kind.shortest}, {kind.longest}, {pattern}}}"
        case Choice():
            options = ", ".join(map(json.dumps, kind.options))
            return f"choiceOf({options})"
        case Position():
            nonzero = "true" if kind.nonzero else "false"
            return f"PositionKind{{{float(kind.bound)!r}, {nonzero}}}"
        case Version():
            return "VersionKind{}"
        case VersionList():
            return f"VersionsKind{{{kind.most}}}"
        case NumberMap():
            return f"NumbersKind{{{kind.most}}}"
        case Ids() | HeldTable() | LoadTable():
            return f"RowsKind{{{kind.most}}}"
        case PartKind():
            return "PartKind{}"
        case PartList():
            return f"PartsKind{{{kind.most}}}"
    raise TypeError(f"no C++ for {type(kind).__name__}")


def _type_of(kind: Kind) -> tuple[str, str]:
    """Return the type of a field, and its initialiser."""
    match kind:
        case Integer():
            return ("std::uint32_t" if kind.high <= _UINT_MOST else "std::uint64_t", " = 0")
        case Number():
            return "double", " = 0"
        case Flag():
            return "bool", " = false"
        case Text() | Choice():
            return "std::string", ""
        case Position():
            return "Vec3", ""
        case Version():
            return "ProtocolVersion", ""
        case VersionList():
            return "std::vector<ProtocolVersion>", ""
        case NumberMap():
            return "std::vector<NamedNumber>", ""
        case Ids():
            return "std::vector<std::uint32_t>", ""
        case HeldTable():
            return "std::vector<HeldRow>", ""
        case LoadTable():
            return "std::vector<SegmentFacts>", ""
        case PartKind():
            return f"{kind.part.__name__}Part", ""
        case PartList():
            return f"std::vector<{kind.part.__name__}Part>", ""
    raise TypeError(f"no C++ for {type(kind).__name__}")


def _all_messages() -> list[type[Message]]:
    return [message for by_type in MESSAGES.values() for message in by_type.values()]


def _camel(name: str) -> str:
    first, *rest = name.split("_")
    return first + "".join(map(str.capitalize, rest))


def _comment(text: str) -> str:
    return " ".join(text.split())
