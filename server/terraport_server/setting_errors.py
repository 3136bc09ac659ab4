"""Settings that cannot be, for the operator: by the name that was typed, the value, what to give.

A setting comes from an option, from the environment, from ``.env``, or is a default. Errors name it
as its field (:class:`~terraport_server.errors.SettingsError`); only the command line knows which of
its names the operator has seen.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from typing import Any, Final

import pydantic
from pydantic_settings import DotEnvSettingsSource

from terraport_server.errors import SettingsError
from terraport_server.settings import ENV_PREFIX, Settings

__all__ = ["read_settings", "typed_name"]

_SHOWN: Final = 60
"""Characters of a wrong value that are repeated."""

_HIDDEN: Final = "a secret"
"""What a secret setting may be; its value is never repeated."""

_UNREADABLE: Final = re.compile(r'field "(\w+)"')
"""How pydantic-settings names a setting whose text is no JSON."""


def read_settings(given: Mapping[str, Any]) -> Settings:
    """Read all settings; what is given wins over the environment, that over ``.env``.

    Raises
    ------
    SettingsError
        When a value is out of its range or not of its type; never with a secret.
    """
    try:
        return Settings(**given)
    except pydantic.ValidationError as error:
        first = error.errors(include_url=False)[0]
        name, value = str(first["loc"][0]), first["input"]
    except ValueError as error:  # pydantic-settings', of a list
        field = _UNREADABLE.search(str(error))
        if field is None:
            raise
        name = field[1]
        value = _environment().get(f"{ENV_PREFIX}{name}".upper())
    received, expected = _shown(value), _expected(name)
    got = "another value" if expected == _HIDDEN else received
    raise SettingsError(name, f"got {got}, expected {expected}") from None


def typed_name(setting: str, options: Mapping[str, str], given: Mapping[str, Any]) -> str:
    """Return the name by which the operator knows a setting.

    Parameters
    ----------
    setting : str
        Its field.
    options : mapping
        Option by field, for those that have one.
    given : mapping
        Fields that options gave a value.

    Returns
    -------
    str
        The option; the variable where that, or ``.env``, gave the value; or for a default the
        option again, if there is one.
    """
    variable = f"{ENV_PREFIX}{setting}".upper()
    if setting in given:
        return options[setting]
    if variable in {name.upper() for name in os.environ}:
        return variable
    if variable in _environment():
        return f"{variable} in .env"
    return options.get(setting, variable)


_KINDS: Final = {
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "array": 'a JSON list such as ["one", "two"]',
    "string": "text",
}
"""JSON Schema's types for people."""


def _shown(value: object) -> str:
    is_number = isinstance(value, int | float)
    return f"{value:.10g}" if is_number else repr(str(value)[:_SHOWN])


def _expected(name: str) -> str:
    """Say what a setting may be: kind and bounds as the settings declare them."""
    schema = Settings.model_json_schema()["properties"][name]
    schema = next(iter(schema.get("anyOf", ())), schema)  # the other choice is none at all
    if schema.get("writeOnly"):
        return _HIDDEN
    if "enum" in schema:
        return " or ".join(map(repr, schema["enum"]))
    if schema.get("format") == "path":
        return "a path"
    if "pattern" in schema:
        return f"text that matches {schema['pattern']}"
    words = [_KINDS[schema["type"]]]
    if "exclusiveMinimum" in schema:
        words.append(f"above {schema['exclusiveMinimum']:,.10g}")
    if "minimum" in schema:
        words.append(f"from {schema['minimum']:,.10g}")
    if "maximum" in schema:
        words.append(f"to {schema['maximum']:,.10g}")
    elif "minimum" in schema:
        words.append("on")
    return " ".join(words)


def _environment() -> dict[str, str | None]:
    """Variables of ``.env`` and, above them, of the process; names in capitals."""
    variables = {**DotEnvSettingsSource(Settings).env_vars, **os.environ}
    return {name.upper(): value for name, value in variables.items()}
