"""What a border weighs: on two faces that fold, lie flat, or differ in colour."""

from __future__ import annotations

import math

import numpy as np
import pytest

from terraport_pipeline.geometry.graph.border_weights import border_weights
from terraport_pipeline.geometry.graph.face_graph import face_graph
from terraport_pipeline.geometry.graph.graph_options import EdgeWeights

SHAPE = EdgeWeights(colour_scale=0.0, concavity=10.0)
COLOUR = EdgeWeights(colour_scale=10.0, colour_noise=0.0, lightness=0.5, concavity=0.0)


def folded(degrees: float):
    """Two faces with normals up that share an edge; positive angles fold downwards (a ridge)."""
    down = math.radians(degrees)
    vertices = np.array(
        [[-1, 0, 0], [0, 0, 0], [0, 0, 1], [math.cos(down), -math.sin(down), 0]], np.float32
    )
    return vertices, np.array([[0, 2, 1], [1, 2, 3]], np.int32)


def weight(vertices, faces, weights, colours=None):
    graph = face_graph(vertices, faces, colours=colours)
    border, _ = border_weights(graph.pairs, graph.length, graph.facts, weights)
    return border[0] / graph.length[0]


@pytest.mark.parametrize("degrees", [0.0, 10.0, 60.0, 120.0])
def test_flat_and_convex_borders_weigh_their_length(degrees):
    assert weight(*folded(degrees), SHAPE) == 1.0


@pytest.mark.parametrize("degrees", [10.0, 30.0, 60.0])
def test_concave_borders_weigh_less(degrees):
    expected = max((1.0 - degrees / 180.0) ** 10, 1e-3)
    assert weight(*folded(-degrees), SHAPE) == pytest.approx(expected, rel=2e-3)


def test_shape_left_out():
    assert weight(*folded(-60.0), EdgeWeights(colour_scale=0.0, concavity=0.0)) == 1.0


def test_colour_difference():
    vertices, faces = folded(0.0)
    grey = np.array([[0, 0, 0], [119, 119, 119], [119, 119, 119], [240, 240, 240]], np.uint8)
    graph = face_graph(vertices, faces, colours=grey)
    lightness = graph.facts.lab[:, 0] / 64.0
    expected = math.exp(-((0.5 * (lightness[1] - lightness[0]) / 10.0) ** 2))
    assert weight(vertices, faces, COLOUR, grey) == pytest.approx(max(expected, 1e-3), rel=1e-3)


def test_scale_follows_the_noise():
    rng = np.random.default_rng(0)
    axis = np.arange(20)
    x, z = np.meshgrid(axis, axis, indexing="ij")
    vertices = np.stack([x.ravel(), np.zeros(400), z.ravel()], axis=1).astype(np.float32)
    i, j = np.divmod(np.arange(19 * 19), 19)
    a = i * 20 + j
    faces = np.stack([a, a + 1, a + 20, a + 20, a + 1, a + 21], axis=1).reshape(-1, 3)
    colours = rng.integers(0, 256, (400, 3)).astype(np.uint8)
    graph = face_graph(vertices, faces.astype(np.int32), colours=colours)
    noisy = EdgeWeights(colour_scale=0.1, colour_noise=2.0)
    _, scale = border_weights(graph.pairs, graph.length, graph.facts, noisy)
    assert scale > 10.0
    _, fixed = border_weights(
        graph.pairs, graph.length, graph.facts, EdgeWeights(colour_scale=0.1, colour_noise=0.0)
    )
    assert fixed == 0.1


@pytest.mark.parametrize("name", ["colour_scale", "colour_noise", "lightness", "concavity"])
@pytest.mark.parametrize("value", [-1.0, 1e9, float("nan")])
def test_values_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} is .*, expected a number in 0"):
        EdgeWeights(**{name: value})
