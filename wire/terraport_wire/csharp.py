"""The messages as C# classes: fields, tables, limits and error codes.

The Unity client's codec (``client_sdk/unity/Core/Wire``) reads, checks and writes by these tables,
so that it cannot drift from the classes here.  The classes read and set their fields by number:
no reflection, which ahead-of-time compilers strip.  PURE: text out, no files;
`terraport_wire.schema` writes it.
"""

from __future__ import annotations

import json
import re

from . import limits
from .codec import PROTOCOL, SUBPROTOCOL
from .errors import CLOSE_CODES, HTTP_STATUS
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
from .message import Field, Message, Part, PartKind, PartList, fields_of
from .messages import MESSAGES, PARTS
from .tables import HeldTable, Ids, LoadTable

__all__ = ["csharp_file"]

_HEAD = """\
// Written by `python -m terraport_wire.schema` from the message classes in Python; do not edit.

using System.Collections.Generic;

namespace Terraport.Wire
{
"""

_INT_MOST = 2**31 - 1
_UINT_MOST = 2**32 - 1


def csharp_file() -> str:
    """Return the text of ``Messages.generated.cs``; same classes, same text."""
    parts = [_class(part, f"{part.__name__}Part", None) for part in PARTS]
    messages = [
        _class(message, f"{message.__name__}Message", message.TYPE) for message in _all_messages()
    ]
    pieces = [_limits(), _close_codes(), *parts, *messages, _registry()]
    return _HEAD + "\n\n".join(pieces) + "\n}\n"


def _limits() -> str:
    lines = [
        "    /// <summary>",
        "    /// Bounds that every speaker keeps (section 12); a server may be stricter.",
        "    /// </summary>",
        "    public static class WireLimits",
        "    {",
        "        /// <summary>Major version of the protocol that this client speaks.</summary>",
        f"        public const int ProtocolMajor = {PROTOCOL[0]};",
        "",
        "        /// <summary>Newest minor version that this client speaks.</summary>",
        f"        public const int ProtocolMinor = {PROTOCOL[1]};",
        "",
        "        /// <summary>The WebSocket subprotocol; it pins the major version.</summary>",
        f"        public const string Subprotocol = {_text(SUBPROTOCOL)};",
    ]
    for name in limits.__all__:
        value = getattr(limits, name)
        kind = _integer_type(0, value) if isinstance(value, int) else "double"
        words = name.lower().replace("_", " ")
        lines += [
            "",
            f"        /// <summary>{words.capitalize()}.</summary>",
            f"        public const {kind} {_pascal(name.lower())} = {_number(value)};",
        ]
    return "\n".join([*lines, "    }"])


def _close_codes() -> str:
    lines = [
        "    /// <summary>The close code of each error where it is fatal (section 11).</summary>",
        "    public static class CloseCodes",
        "    {",
    ]
    for code, close in CLOSE_CODES.items():
        lines += [
            f"        /// <summary>Of <c>{code.value}</c>.</summary>",
            f"        public const int {_pascal(code.value)} = {int(close)};",
            "",
        ]
    lines += [
        "        internal static readonly KeyValuePair<string, int>[] ByError =",
        "        {",
        *(
            f"            new KeyValuePair<string, int>({_text(code.value)}, {int(close)}),"
            for code, close in CLOSE_CODES.items()
        ),
        "        };",
        "",
        "        internal static readonly KeyValuePair<int, int>[] ByHttpStatus =",
        "        {",
        *(
            f"            new KeyValuePair<int, int>({status}, {int(close)}),"
            for close, status in HTTP_STATUS.items()
        ),
        "        };",
        "    }",
    ]
    return "\n".join(lines)


def _class(part: type[Part], name: str, type_name: str | None) -> str:
    base = "WirePart" if type_name is None else "WireMessage"
    fields = fields_of(part)
    lines = [
        f"    /// <summary>{_comment(part.__doc__ or '')}.</summary>",
        f"    public sealed class {name} : {base}",
        "    {",
        *_table(fields),
    ]
    if type_name is not None:
        lines += [
            "",
            "        /// <inheritdoc/>",
            "        public override string Type",
            "        {",
            f"            get {{ return {_text(type_name)}; }}",
            "        }",
        ]
    for field in fields:
        absent = "" if field.required else " Null where absent."
        lines += [
            "",
            f"        /// <summary>{_comment(field.meaning)}.{absent}</summary>",
            f"        public {_type_of(field)} {_pascal(field.name)} {{ get; set; }}",
        ]
    return "\n".join([*lines, *_accessors(fields), "    }"])


def _table(fields: tuple[Field, ...]) -> list[str]:
    lines = ["        internal static readonly Field[] Table ="]
    lines += ["        {"]
    for field in fields:
        required = "true" if field.required else "false"
        lines.append(
            f"            new Field({_text(field.name)}, {required}, {_kind(field.kind)}),"
        )
    return [*lines, "        };"]


def _accessors(fields: tuple[Field, ...]) -> list[str]:
    lines = [
        "",
        "        internal override Field[] Fields",
        "        {",
        "            get { return Table; }",
        "        }",
        "",
        "        internal override object Get(int field)",
        "        {",
    ]
    if fields:
        lines += ["            switch (field)", "            {"]
        lines += [
            f"                case {number}: return {_getter(field)};"
            for number, field in enumerate(fields)
        ]
        lines += ["            }"]
    lines += [
        "            throw NoField(field);",
        "        }",
        "",
        "        internal override void Set(int field, object value)",
        "        {",
    ]
    if fields:
        lines += ["            switch (field)", "            {"]
        lines += [
            f"                case {number}: {_pascal(field.name)} = {_setter(field)}; return;"
            for number, field in enumerate(fields)
        ]
        lines += ["            }"]
    return [*lines, "            throw NoField(field);", "        }"]


def _registry() -> str:
    lines = [
        "    /// <summary>Which messages there are in each direction.</summary>",
        "    internal static class MessageTypes",
        "    {",
    ]
    for direction, messages in MESSAGES.items():
        lines += [
            f"        internal static readonly string[] {_pascal(direction.value)} =",
            "        {",
            *(f"            {_text(name)}," for name in messages),
            "        };",
            "",
        ]
    lines += [
        "        /// <summary>An empty message; null where that direction has none.</summary>",
        "        internal static WireMessage Create(Direction direction, string type)",
        "        {",
    ]
    for direction, messages in MESSAGES.items():
        lines += [
            f"            if (direction == Direction.{_pascal(direction.value)})",
            "            {",
            "                switch (type)",
            "                {",
            *(
                f"                    case {_text(name)}: return new {message.__name__}Message();"
                for name, message in messages.items()
            ),
            "                }",
            "            }",
        ]
    return "\n".join([*lines, "            return null;", "        }", "    }"])


def _kind(kind: Kind) -> str:
    match kind:
        case Integer():
            return f"new IntegerKind({_long(kind.low)}, {_long(kind.high)})"
        case Number():
            excluded = "true" if kind.low_excluded else "false"
            return f"new NumberKind({_number(kind.low)}, {_number(kind.high)}, {excluded})"
        case Flag():
            return "new FlagKind()"
        case Text():
            pattern = "null" if kind.pattern is None else _text(kind.pattern)
            return f"new TextKind({kind.shortest}, {kind.longest}, {pattern})"
        case Choice():
            return f"new ChoiceKind({', '.join(map(_text, kind.options))})"
        case Position():
            nonzero = "true" if kind.nonzero else "false"
            return f"new PositionKind({_number(kind.bound)}, {nonzero})"
        case Version():
            return "new VersionKind()"
        case VersionList():
            return f"new VersionsKind({kind.most})"
        case NumberMap():
            return f"new NumbersKind({kind.most})"
        case Ids():
            return f"new IdsKind({kind.most})"
        case HeldTable():
            return f"new HeldKind({kind.most})"
        case LoadTable():
            return f"new LoadKind({kind.most})"
        case PartKind():
            name = _text(kind.part.wire_name())
            return f"new PartKind(() => new {kind.part.__name__}Part(), {name})"
        case PartList():
            return f"new PartsKind(() => new {kind.part.__name__}Part(), {kind.most})"
    raise TypeError(f"no C# for {type(kind).__name__}")


def _type_of(field: Field) -> str:
    name, by_value = _plain_type(field.kind)
    return f"{name}?" if by_value and not field.required else name


def _plain_type(kind: Kind) -> tuple[str, bool]:
    """Return the C# type, and whether it is a value type."""
    match kind:
        case Integer():
            return _integer_type(kind.low, kind.high), True
        case Number():
            return "double", True
        case Flag():
            return "bool", True
        case Text() | Choice():
            return "string", False
        case Position():
            return "Vec3", True
        case Version():
            return "ProtocolVersion", True
        case VersionList():
            return "ProtocolVersion[]", False
        case NumberMap():
            return "KeyValuePair<string, double>[]", False
        case Ids():
            return "uint[]", False
        case HeldTable():
            return "HeldRow[]", False
        case LoadTable():
            return "SegmentFacts[]", False
        case PartKind():
            return f"{kind.part.__name__}Part", False
        case PartList():
            return f"{kind.part.__name__}Part[]", False
    raise TypeError(f"no C# for {type(kind).__name__}")


def _getter(field: Field) -> str:
    name = _pascal(field.name)
    if not isinstance(field.kind, Integer):
        return name
    # Integers pass the tables as one type.
    if field.required:
        return f"(long){name}"
    return f"{name}.HasValue ? (object)(long){name}.Value : null"


def _setter(field: Field) -> str:
    kind = field.kind
    name, by_value = _plain_type(kind)
    if isinstance(kind, PartList):
        return f"Parts<{kind.part.__name__}Part>(value)"
    if not by_value:
        return f"({name})value"
    given = f"({name})(long)value" if isinstance(kind, Integer) else f"({name})value"
    return given if field.required else f"value == null ? ({name}?)null : {given}"


def _integer_type(low: int, high: int) -> str:
    if low >= -_INT_MOST and high <= _INT_MOST:
        return "int"
    return "uint" if low >= 0 and high <= _UINT_MOST else "long"


def _all_messages() -> list[type[Message]]:
    return [message for by_type in MESSAGES.values() for message in by_type.values()]


def _pascal(name: str) -> str:
    return "".join(word[:1].upper() + word[1:] for word in name.split("_"))


def _comment(text: str) -> str:
    plain = " ".join(text.split()).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"`([^`]*)`", r"<c>\1</c>", plain).removesuffix(".")


def _text(value: str) -> str:
    return json.dumps(value)


def _long(value: int) -> str:
    return f"{value}L"


def _number(value: float) -> str:
    return repr(value)
