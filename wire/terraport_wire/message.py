"""The base of every message: frozen dataclass in, checked fields out.

A message class declares each field as ``Annotated[type, Kind, "meaning"]``.  :func:`fields_of`
reads these once per class; construction checks by them, the codec walks them.
"""

# ruff: noqa: D102 - PartKind: the interface Kind documents these methods
from __future__ import annotations

import dataclasses
import types
import typing
from enum import Enum, unique
from typing import Any, ClassVar

import numpy as np

from .errors import InvalidMessageError
from .kinds import Kind, Refused, clip

__all__ = ["Direction", "Field", "Message", "Part", "PartKind", "PartList", "fields_of"]


# Filled once per class; keyed by name because dataclass(slots=True) makes each class twice.
_FIELDS: dict[tuple[str, str], tuple[Field, ...]] = {}


@unique
class Direction(Enum):
    """Who sends a message."""

    CLIENT_TO_SERVER = "client_to_server"
    SERVER_TO_CLIENT = "server_to_client"


@dataclasses.dataclass(frozen=True, slots=True)
class Field:
    """One field of a message.

    Attributes
    ----------
    name : str
        Name in Python and on the wire.
    kind : Kind
        Check and wire form.
    required : bool
        False if it may be absent; absent is ``None`` in Python.
    meaning : str
        One sentence for readers of the class.
    """

    name: str
    kind: Kind
    required: bool
    meaning: str


class Part:
    """A frozen dataclass whose fields are checked on construction.

    Raises
    ------
    InvalidMessageError
        If a field is not what its kind allows, or two fields contradict each other.
    """

    __slots__ = ()

    def __post_init__(self) -> None:
        for field in fields_of(type(self)):
            value = getattr(self, field.name)
            if value is None and not field.required:
                continue
            try:
                checked = field.kind.check(value)
            except Refused as refused:
                path = f"{field.name}.{refused.path}" if refused.path else field.name
                raise InvalidMessageError(self.wire_name(), path, refused.text) from None
            if checked is not value:
                object.__setattr__(self, field.name, checked)
        problem = self.contradiction()
        if problem is not None:
            raise InvalidMessageError(self.wire_name(), *problem)

    @classmethod
    def wire_name(cls) -> str:
        """Return the name that error texts use."""
        return cls.__name__.lower()

    def contradiction(self) -> tuple[str, str] | None:
        """Return (field, text) if two fields contradict each other, else None."""
        return None

    def __eq__(self, other: object) -> bool:
        """Compare type and fields; arrays compare as wholes."""
        if type(other) is not type(self):
            return NotImplemented
        return all(
            _equal(getattr(self, field.name), getattr(other, field.name))
            for field in fields_of(type(self))
        )

    __hash__ = None  # type: ignore[assignment]  # arrays inside: not hashable


class Message(Part):
    """Base of every message; ``TYPE`` is its name on the wire, ``DIRECTION`` who sends it."""

    __slots__ = ()

    TYPE: ClassVar[str]
    DIRECTION: ClassVar[Direction]

    @classmethod
    def wire_name(cls) -> str:
        """Return the type on the wire."""
        return cls.TYPE


class PartKind:
    """A nested map that is a :class:`Part`; unknown keys in it are skipped."""

    def __init__(self, part: type[Part]) -> None:
        self.part = part

    def check(self, value: Any) -> Part:
        if not isinstance(value, self.part):
            raise Refused(f"got {clip(value)}, expected {self.part.__name__}")
        return value

    def to_wire(self, value: Any) -> dict[str, Any]:
        return to_map(value)

    def from_wire(self, raw: Any) -> Part:
        return from_map(self.part, raw)

    def describe(self) -> str:
        return "a map"


class PartList:
    """A list of maps that are :class:`Part` of one class, at most `most`."""

    def __init__(self, part: type[Part], most: int) -> None:
        self.part = part
        self.most = most
        self._kind = PartKind(part)

    def check(self, value: Any) -> tuple[Part, ...]:
        if not isinstance(value, (list, tuple)) or len(value) > self.most:
            raise Refused(f"got {clip(value)}, expected at most {self.most} maps")
        return tuple(self._kind.check(item) for item in value)

    def to_wire(self, value: Any) -> list[Any]:
        return [to_map(item) for item in value]

    def from_wire(self, raw: Any) -> tuple[Part, ...]:
        if not isinstance(raw, list) or len(raw) > self.most:
            raise Refused(f"got {clip(raw)}, expected a list of at most {self.most} maps")
        parts = []
        for number, item in enumerate(raw):
            try:
                parts.append(self._kind.from_wire(item))
            except Refused as refused:
                path = f"{number}.{refused.path}" if refused.path else str(number)
                raise Refused(refused.text, path) from None
        return tuple(parts)

    def describe(self) -> str:
        return f"a list of at most {self.most} maps"


def fields_of(part: type[Part]) -> tuple[Field, ...]:
    """Return the fields of a message or part class, in order of declaration."""
    name = (part.__module__, part.__qualname__)
    fields = _FIELDS.get(name)
    if fields is None:
        fields = _FIELDS[name] = _read_fields(part)
    return fields


def to_map(part: Part) -> dict[str, Any]:
    """Return the map of a part for msgpack; absent fields are left out."""
    plain: dict[str, Any] = {}
    for field in fields_of(type(part)):
        value = getattr(part, field.name)
        if value is not None:
            plain[field.name] = field.kind.to_wire(value)
    return plain


def from_map(part: type[Part], raw: Any) -> Part:
    """Return the part that a decoded map holds; unknown keys are skipped, null is absent.

    Raises
    ------
    Refused
        With the path of the field that is missing, mistyped or out of range.
    """
    if not isinstance(raw, dict):
        raise Refused(f"got {clip(raw)}, expected a map")
    values: dict[str, Any] = {}
    for field in fields_of(part):
        value = raw.get(field.name)
        if value is None:
            if field.required:
                raise Refused("got nothing, expected " + field.kind.describe(), field.name)
            continue
        try:
            values[field.name] = field.kind.from_wire(value)
        except Refused as refused:
            path = f"{field.name}.{refused.path}" if refused.path else field.name
            raise Refused(refused.text, path) from None
    try:
        return part(**values)
    except InvalidMessageError as error:
        raise Refused(error.text, error.field) from None


def _read_fields(part: type[Part]) -> tuple[Field, ...]:
    hints = typing.get_type_hints(part, include_extras=True)
    return tuple(_field(item, hints[item.name]) for item in dataclasses.fields(part))  # type: ignore[arg-type]


def _field(item: dataclasses.Field[Any], hint: Any) -> Field:
    if typing.get_origin(hint) in (typing.Union, types.UnionType):  # Optional added by a default
        hint = next(
            inner for inner in typing.get_args(hint) if typing.get_origin(inner) is typing.Annotated
        )
    _, kind, meaning = typing.get_args(hint)
    required = item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING
    return Field(item.name, kind, required, meaning)


def _equal(left: object, right: object) -> bool:
    if isinstance(left, np.ndarray) or isinstance(right, np.ndarray):
        return (
            isinstance(left, np.ndarray)
            and isinstance(right, np.ndarray)
            and left.dtype == right.dtype
            and np.array_equal(left, right)
        )
    return left == right
