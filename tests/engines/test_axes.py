"""Axes, units, winding and V: what each engine would draw is what the Python SDK draws."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import PIL.Image
import pytest
from engines.axes_pictures import ENGINES, PICTURE, drawn_by_client, drawn_by_sdk
from engines.engine_view import CONVENTIONS, Drawn, draw
from engines.programs import Client
from faults.service import Service

SAME = 0.005
"""Share of pixels that may differ: outlines fall to one side or the other by rounding."""
DIFFERENT = 0.02
"""Less than that, and the test could not tell."""


def differing(first: Any, second: Any) -> float:
    """Return the share of pixels that are not nearly the same colour."""
    apart = np.abs(first.astype(int) - second.astype(int)).max(axis=2)
    return float((apart > 6).mean())


@pytest.fixture(scope="module")
def reference(server: Service) -> Any:
    return draw(drawn_by_sdk(f"{server.url}/scenes/axes"), CONVENTIONS["scene"])


@pytest.fixture(scope="module")
def meshes(client: Client, server: Service) -> list[Drawn]:
    return drawn_by_client(client, f"{server.url}/scenes/axes")


def test_the_engine_draws_what_the_python_sdk_draws(
    client: Client, meshes: list[Drawn], reference: Any
) -> None:
    engine = CONVENTIONS[ENGINES[client.language]]
    assert differing(draw(meshes, engine), reference) < SAME


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_mirrored_axis_would_be_seen(
    client: Client, meshes: list[Drawn], reference: Any, axis: int
) -> None:
    sign = np.ones(3)
    sign[axis] = -1
    wrong = [replace(mesh, positions=mesh.positions * sign) for mesh in meshes]
    engine = CONVENTIONS[ENGINES[client.language]]
    assert differing(draw(wrong, engine), reference) > DIFFERENT


def test_a_turned_winding_would_be_seen(
    client: Client, meshes: list[Drawn], reference: Any
) -> None:
    wrong = [replace(mesh, faces=mesh.faces[:, [0, 2, 1]]) for mesh in meshes]
    engine = CONVENTIONS[ENGINES[client.language]]
    assert differing(draw(wrong, engine), reference) > DIFFERENT


def test_an_image_upside_down_would_be_seen(
    client: Client, meshes: list[Drawn], reference: Any
) -> None:
    wrong = [
        mesh if mesh.uvs is None else replace(mesh, uvs=mesh.uvs * [1, -1] + [0, 1])
        for mesh in meshes
    ]
    engine = CONVENTIONS[ENGINES[client.language]]
    assert differing(draw(wrong, engine), reference) > SAME * 2


def test_normals_point_out_of_their_faces(client: Client, meshes: list[Drawn]) -> None:
    """By the engine's own rule of a face's front, component by component."""
    left_handed_front_clockwise = CONVENTIONS[ENGINES[client.language]].front_clockwise
    for mesh in meshes:
        corners = mesh.positions[mesh.faces]
        first_edge, second_edge = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        front = (
            np.cross(first_edge, second_edge)
            if left_handed_front_clockwise
            else np.cross(second_edge, first_edge)
        )
        normals = mesh.normals[mesh.faces[:, 0]]
        assert (np.einsum("ij,ij->i", front, normals) > 0).all()


def test_the_picture_in_the_docs_is_what_is_drawn(
    client: Client, meshes: list[Drawn], reference: Any
) -> None:
    sheet = np.asarray(PIL.Image.open(PICTURE).convert("RGB"))
    height, width, _ = reference.shape
    column = 2  # behind Unity
    for number, picture in (
        (0, reference),
        (column, draw(meshes, CONVENTIONS[ENGINES[client.language]])),
    ):
        left = number * (width + 8)
        shown = sheet[:height, left : left + width]
        apart = np.abs(shown.astype(int) - picture.astype(int)).max(axis=2)
        assert (apart > 24).mean() < 0.01, "python tests/engines/axes_pictures.py draws it anew"
