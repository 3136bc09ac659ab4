"""The core of the Unity package, compiled by Mono: corpora, decoding, axes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engines.axes_pictures import drawn_by_sdk, drawn_by_unity
from engines.engine_view import CONVENTIONS, Drawn, draw
from engines.unity import Unity
from faults.service import Service
from sdk.test_places import LABELS, REGIONS, UNITED
from server.grid_scene import SCALES, STEP_M, tile_mesh

from terraport.places import coarser_pieces, places_of
from terraport_payload import encode_segment

CONFORMANCE = Path(__file__).resolve().parents[1] / "conformance"
CORPORA = {
    "landings": CONFORMANCE / "landings",
    "messages": CONFORMANCE / "messages",
    "payload": CONFORMANCE / "scene" / "payload",
}
SAME = 0.005
"""Share of pixels that may differ: outlines fall to one side or the other by rounding."""
DIFFERENT = 0.02
INFLATER_BYTES = 5000
"""The inflater is made for each stream: a buffer of 4096 bytes, and some objects."""


def cases(kind: str) -> int:
    """Count the cases of a corpus that are a client's."""
    folder = CORPORA[kind]
    if kind == "payload":
        return len(list(folder.glob("*.tsg")))
    lines = [line for path in folder.glob("*.jsonl") for line in path.read_text().splitlines()]
    return sum(json.loads(line).get("from", "server") == "server" for line in lines)


@pytest.mark.parametrize("kind", CORPORA)
def test_the_whole_corpus_passes(unity: Unity, kind: str) -> None:
    passed, failed, output = unity.corpus(kind, CORPORA[kind])
    assert failed == 0, output[-4000:]
    assert passed == cases(kind) > 40


@pytest.mark.parametrize(
    ("kind", "name", "old", "new"),
    [
        ("landings", "landings.jsonl", '"radius_m":22.0', '"radius_m":23.0'),
        ("landings", "landings.jsonl", '"hidden":"', '"hidden":"0'),
        ("landings", "landings.jsonl", '"shown":["', '"shown":["0'),
        ("landings", "landings.jsonl", '"inner":[', '"inner":[9'),
        ("messages", "good.jsonl", '"effective_radius_m":41.25', '"effective_radius_m":41.5'),
        ("payload", "good-colours.tsg.json", '"colours":[[', '"colours":[[1'),
    ],
)
def test_a_wrong_expectation_is_noticed(
    unity: Unity, kind: str, name: str, old: str, new: str, tmp_path: Path
) -> None:
    text = (CORPORA[kind] / name).read_text()
    lines = text.splitlines() if name.endswith("l") else [text]
    line = next(line for line in lines if old in line)
    (tmp_path / name).write_text(line.replace(old, new, 1))
    if kind == "payload":
        path = CORPORA[kind] / name.removesuffix(".json")
        (tmp_path / path.name).write_bytes(path.read_bytes())
    assert unity.corpus(kind, tmp_path)[:2] == (0, 1)


def test_decoding_allocates_nothing_that_grows_with_a_segment(unity: Unity, tmp_path: Path) -> None:
    paths = [tmp_path / f"{size}.tsg" for size in (20, 25, 30, 35)]
    for path in paths:
        mesh = tile_mesh(0, 1, int(path.stem))
        path.write_bytes(encode_segment(mesh, step_m=STEP_M, scales=SCALES))
    done = unity.run("decode", 0.5, len(SCALES), *paths)
    figures = json.loads(done.stdout.strip().splitlines()[-1])
    assert figures["segments"] >= 40
    assert 1000 < figures["allocated_bytes_per_segment"] <= INFLATER_BYTES


def differing(first: Any, second: Any) -> float:
    """Return the share of pixels that are not nearly the same colour."""
    apart = np.abs(first.astype(int) - second.astype(int)).max(axis=2)
    return float((apart > 6).mean())


@pytest.fixture(scope="module")
def reference(server: Service) -> Any:
    return draw(drawn_by_sdk(f"{server.url}/scenes/axes"), CONVENTIONS["scene"])


@pytest.fixture(scope="module")
def meshes(unity: Unity, server: Service) -> list[Drawn]:
    return drawn_by_unity(unity, f"{server.url}/scenes/axes")


def test_unity_draws_what_the_python_sdk_draws(meshes: list[Drawn], reference: Any) -> None:
    assert differing(draw(meshes, CONVENTIONS["unity"]), reference) < SAME


@pytest.mark.parametrize("fault", ["x", "y", "z", "winding", "image"])
def test_a_wrong_turn_would_be_seen(meshes: list[Drawn], reference: Any, fault: str) -> None:
    if fault == "winding":
        wrong = [replace(mesh, faces=mesh.faces[:, [0, 2, 1]]) for mesh in meshes]
    elif fault == "image":
        wrong = [
            mesh if mesh.uvs is None else replace(mesh, uvs=mesh.uvs * [1, -1] + [0, 1])
            for mesh in meshes
        ]
    else:
        sign = np.where([axis == fault for axis in "xyz"], -1, 1)
        wrong = [replace(mesh, positions=mesh.positions * sign) for mesh in meshes]
    bound = 2 * SAME if fault == "image" else DIFFERENT
    assert differing(draw(wrong, CONVENTIONS["unity"]), reference) > bound


def test_normals_point_out_of_their_faces(meshes: list[Drawn]) -> None:
    """By Unity's rule: the front of a face is clockwise."""
    for mesh in meshes:
        corners = mesh.positions[mesh.faces]
        front = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = mesh.normals[mesh.faces[:, 0]]
        assert (np.einsum("ij,ij->i", front, normals) > 0).all()


@pytest.mark.parametrize("document", [REGIONS, UNITED], ids=["places", "pieces"])
def test_places_and_pieces_are_those_of_the_python_sdk(
    unity: Unity, document: dict[str, Any], tmp_path: Path
) -> None:
    regions, labels = tmp_path / "regions.json", tmp_path / "labels.json"
    rows = [row | {"id": at} for at, row in enumerate(document["regions"]) if row != "no region"]
    regions.write_text(json.dumps(document | {"regions": rows}))
    labels.write_text(json.dumps(LABELS))
    told = json.loads(unity.run("regions", regions, labels, 1).stdout)
    assert told["places"] == [
        [
            place.label,
            place.stable_id,
            list(place.position),
            place.radius_m,
            place.heading_deg,
            place.is_view,
        ]
        for place in places_of(document, LABELS)
    ]
    assert told["pieces"] == [
        [piece.cost, list(piece.regions), piece.area_m2, piece.label]
        for piece in coarser_pieces(document, LABELS, 1)
    ]
