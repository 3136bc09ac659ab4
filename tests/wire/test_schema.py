"""The generated files are current, and the schemas agree with the decoder on the corpus."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import msgpack
import numpy as np
import pytest
from conformance.generate import CORPUS
from conformance.wire_samples import readable_value
from referencing import Registry, Resource

from terraport_wire import Direction, schema
from terraport_wire.message import fields_of
from terraport_wire.messages import MESSAGES, PARTS
from terraport_wire.tables import HeldTable, Ids, LoadTable

ROOT = Path(__file__).resolve().parents[2]
SPEC = ROOT / "spec"
TYPESCRIPT = ROOT / "client_sdk/web/src/core/wire/messages.generated.ts"

# Relations between fields, and ids once per table: the specification says them, JSON Schema cannot.
_BEYOND_SCHEMA = frozenset(
    {
        "box_inverted",
        "coarse_below_radius",
        "deadline_without_inner",
        "stall_without_inner",
        "direction_zero",
        "held_twice",
        "inner_beyond_radius",
        "keep_and_nearby",
        "load_and_keep",
        "load_twice",
        "omitted_without_reason",
        "reason_without_omitted",
        "sum_of_bytes",
        "sum_of_triangles",
        "total_below_load",
    }
)

# What the readable form cannot say: it is JSON, where every number is finite and a list is a list.
_ON_THE_WIRE_ALONE = frozenset(
    {
        "box_infinite",
        "box_nan",
        "direction_nan",
        "ids_as_array",
        "position_infinite",
        "position_nan",
        "radius_infinite",
        "radius_nan",
        "release_factor_nan",
    }
)


@pytest.fixture(scope="module")
def validators() -> dict[str, Any]:
    schemas = {name: json.loads(text) for name, text in schema.schema_files().items()}
    registry: Registry[Any] = Registry().with_resources(
        (text["$id"], Resource.from_contents(text)) for text in schemas.values()
    )
    for text in schemas.values():
        jsonschema.Draft202012Validator.check_schema(text)
    return {
        name.removesuffix(".json"): jsonschema.Draft202012Validator(text, registry=registry)
        for name, text in schemas.items()
    }


def test_the_committed_files_are_what_the_script_writes() -> None:
    languages = ["--typescript", str(TYPESCRIPT)]
    assert schema.main([str(SPEC), *languages, "--check"]) == 0
    on_disk = {path.name for path in (SPEC / "schema").iterdir()}
    assert on_disk == set(schema.schema_files())


def test_check_reports_a_stale_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (SPEC / "wire-protocol.md").read_text().replace("| `radius_m` |", "| `radius` |")
    (tmp_path / "wire-protocol.md").write_text(text)
    assert schema.main([str(tmp_path), "--check"]) == 1
    assert "wire-protocol.md is not what terraport_wire.schema generates" in capsys.readouterr().err
    assert schema.main([str(tmp_path)]) == 0
    assert schema.main([str(tmp_path), "--check"]) == 0


def test_check_reports_stale_typescript(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stale = tmp_path / "messages.generated.ts"
    stale.write_text(TYPESCRIPT.read_text().replace("radius_m", "radius"))
    arguments = [str(SPEC), "--typescript", str(stale)]
    assert schema.main([*arguments, "--check"]) == 1
    assert "messages.generated.ts is not what" in capsys.readouterr().err
    assert schema.main(arguments) == 0
    assert stale.read_text() == TYPESCRIPT.read_text()


def test_the_typescript_names_every_message_field_and_rule() -> None:
    text = TYPESCRIPT.read_text()
    for messages in MESSAGES.values():
        for name, message in messages.items():
            assert f"    {name}: [" in text
            assert f"export interface {message.__name__}Message {{" in text
            for field in fields_of(message):
                assert f'{{ name: "{field.name}", required: ' in text
    assert 'export type MessageWithRule = "aim" | "land" | "gather" | "plan" | "prefetch";' in text


def test_the_specification_has_a_table_for_every_message_and_part() -> None:
    text = (SPEC / "wire-protocol.md").read_text()
    names = [name for messages in MESSAGES.values() for name in messages]
    names += [part_type.wire_name() for part_type in PARTS]
    for name in [*names, "error-codes"]:
        assert text.count(f"<!-- generated: {name} -->") == 1


@pytest.mark.parametrize(
    "path", sorted((CORPUS / "good").glob("message-*.json")), ids=lambda p: p.stem
)
def test_good_messages_match_their_schema(path: Path, validators: dict[str, Any]) -> None:
    facts = json.loads(path.read_bytes())
    if "message" not in facts:
        return
    message = facts["message"]
    validators[message["type"]].validate(message)
    validators[facts["direction"]].validate(message)


@pytest.mark.parametrize(
    "path", sorted((CORPUS / "bad").glob("message-*-*.json")), ids=lambda p: p.stem
)
def test_bad_fields_do_not_match_their_schema(path: Path, validators: dict[str, Any]) -> None:
    facts = json.loads(path.read_bytes())
    if facts["error"]["code"] != "invalid_field":
        return
    feature = path.stem.rsplit("-", 1)[1]
    if feature in _ON_THE_WIRE_ALONE:
        return
    message = msgpack.unpackb(path.with_suffix(".bin").read_bytes())
    for field in fields_of(MESSAGES[Direction(facts["direction"])][message["type"]]):
        if isinstance(field.kind, (Ids, HeldTable, LoadTable)):
            message[field.name] = _rows(field.kind, message.get(field.name))
    expected = feature in _BEYOND_SCHEMA
    assert validators[message["type"]].is_valid(message) == expected


def _rows(kind: Ids | HeldTable | LoadTable, raw: object) -> object:
    """Return a table's bytes as rows; whatever else, and bytes that are no rows, as text."""
    if raw is None or isinstance(raw, bool):
        return raw
    size = kind.dtype.itemsize
    if not isinstance(raw, bytes) or len(raw) % size:
        return str(raw)
    return readable_value(kind, np.frombuffer(raw, dtype=kind.dtype))
