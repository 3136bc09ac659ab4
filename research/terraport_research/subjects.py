"""What reconstruction is tried on: samples of surfaces that are known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import trimesh

from terraport_payload.types import Float32, Float64, Int32, UInt8
from terraport_pipeline.errors import OptionError, SurveyError
from terraport_pipeline.geometry.clouds.normals import estimate_normals
from terraport_pipeline.geometry.clouds.spacing import estimate_spacing, nearest_neighbours
from terraport_pipeline.geometry.mesh.mesh_edges import edge_facts
from terraport_pipeline.geometry.mesh.uniform_samples import sample_mesh
from terraport_pipeline.model import to_scene
from terraport_pipeline.stages import clean
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.synth.bodies import BODIES
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import synthesise
from terraport_pipeline.synth.truth_mesh import truth_mesh
from terraport_research.reconstructors import Samples

__all__ = ["NOISE_SPACINGS", "STANFORD", "Subject", "body", "mesh_subject", "quarry", "stanford"]

NOISE_SPACINGS: Final = 0.05
"""Standard deviation of the samples' error on bodies, per axis, in spacings: a good scanner."""

NORMAL_NEIGHBOURS: Final = 16

BODY_SIZE_M: Final = 10.0
"""Bodies are scaled to this: a bunny in its own unit is 0.15 wide and an armadillo 150."""

STANFORD: Final = {"bunny": "stanford/bunny.ply", "armadillo": "stanford/armadillo.obj"}
"""Where the models of the Stanford 3D Scanning Repository lie in a data folder."""

_CHECKS: Final = 40_000
"""Places on the truth whose distance to the reconstruction is measured."""

_TRUTH_EDGE_SPACINGS: Final = 0.6
"""Longest edge of the quarry's true mesh."""

_CLEAN_THREADS: Final = 2


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """Samples with the surface that they were taken from."""

    key: str
    title: str
    samples: Samples
    truth_vertices: Float32
    """(V, 3) metres, Y up."""
    truth_faces: Int32
    """(F, 3)."""
    seen: Float32
    """(C, 3) places on the truth that the samples saw: a reconstruction should pass through."""
    rim: Float32
    """(R, 3) places along which the truth itself ends: edges of a reconstruction there are no
    holes. R = 0 for closed bodies."""
    closed: bool
    """A body, not a piece of ground."""
    origin: str = ""
    """Where the data is from and on which terms."""
    neighbour_colour_p95: float = 0.0
    """Difference in colour between a sample and the nearest other one (grey levels, the channel
    that differs most): 95 % of the samples have less."""


def body(name: str, points: int) -> Subject:
    """Sample one of the project's own bodies.

    Raises
    ------
    OptionError
        There is no such body.
    """
    if name not in BODIES:
        raise OptionError(f"body {name!r}; expected one of {', '.join(BODIES)}")
    vertices, faces = BODIES[name]()
    return mesh_subject(name, name.capitalize(), vertices, faces, points, origin="own, procedural")


def stanford(name: str, data: Path | None, points: int) -> Subject:
    """Sample a Stanford model.

    Raises
    ------
    SurveyError
        The file is not there or holds no triangle mesh; the text says what to do.
    """
    if data is None:
        raise SurveyError(
            f"{STANFORD[name]} not looked for: name the folder of real data with --data"
        )
    path = data / STANFORD[name]
    if not path.is_file():
        raise SurveyError(
            f"{path} is not there: get the {name} from the Stanford 3D Scanning Repository "
            "(research use, with credit)"
        )
    mesh = trimesh.load(path, process=False)
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise SurveyError(f"{path} holds no triangle mesh; get it again")
    return mesh_subject(
        name,
        f"Stanford {name}",
        np.asarray(mesh.vertices, np.float64),
        np.asarray(mesh.faces, np.int32),
        points,
        origin="Stanford Computer Graphics Laboratory, research use with credit",
    )


def mesh_subject(
    key: str, title: str, vertices: Float64, faces: Int32, points: int, *, origin: str = ""
) -> Subject:
    """Sample a mesh as a scanner would: even, with noise, coloured, normals from the samples.

    The normals' directions are estimated from the noisy samples; their signs are the truth's, since
    a scanner knows the side that it saw.
    """
    # (1) A body of standard size, faces turned outwards.
    rng = np.random.default_rng([len(faces), points])
    vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    vertices = vertices * (BODY_SIZE_M / float(np.ptp(vertices, axis=0).max()))
    faces = _turned_out(vertices, faces)
    # (2) Even samples with noise; normals are estimated from them, as of a scan, and turned
    # outwards.
    samples, face = sample_mesh(vertices, faces, points, rng)
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = float(np.linalg.norm(normal, axis=1).sum() / 2)
    noise = NOISE_SPACINGS * np.sqrt(area / points)
    measured = (samples + rng.normal(size=samples.shape) * noise).astype(np.float32)
    neighbours = nearest_neighbours(measured, NORMAL_NEIGHBOURS, workers=1)
    spacing = estimate_spacing(neighbours)
    normals, _ = estimate_normals(measured, neighbours, k=NORMAL_NEIGHBOURS)
    inward = np.einsum("ij,ij->i", normals, normal[face]) < 0
    normals = np.where(inward[:, None], -normals, normals)
    # (3) Points of the truth to measure against.
    checks, _ = sample_mesh(vertices, faces, min(_CHECKS, 2 * points), rng)
    open_edges = edge_facts(faces).open_edges
    colours = _painted(samples, vertices)
    return Subject(
        key,
        title,
        Samples(
            measured,
            normals.astype(np.float32),
            colours,
            spacing.local_m,
            spacing.areal_m,
        ),
        vertices.astype(np.float32),
        faces,
        checks.astype(np.float32),
        _along(vertices, open_edges, 0.25 * spacing.areal_m),
        closed=True,
        origin=origin,
        neighbour_colour_p95=_neighbour_colour(colours, neighbours.indices[:, 0]),
    )


def quarry(points: int, scratch: Path) -> Subject:
    """Make the synthetic quarry and clean it as a build does.

    Its colours are photographed ones; the truth is the generator's own surface.
    """
    options = QuarryOptions(points=max(points, 1000), holes=0)
    synthetic = synthesise(options)
    # Threads change nothing but the time.
    cleaned = clean.run(synthetic.survey, clean.Options(), Context(scratch, threads=_CLEAN_THREADS))
    cloud = cleaned.cloud
    true = truth_mesh(options, _TRUTH_EDGE_SPACINGS * cloud.spacing_m)
    shift = to_scene(
        np.array([[options.easting_m, options.northing_m, options.elevation_m]]), cloud.origin
    )
    vertices = true.vertices + shift
    seen = to_scene(synthetic.truth[synthetic.material != Material.OUTLIER], cloud.origin)
    edges = edge_facts(true.faces).open_edges
    low, high = vertices[:, ::2].min(axis=0), vertices[:, ::2].max(axis=0)
    neighbours = nearest_neighbours(cloud.points, 1, workers=1)
    plan = vertices[edges][..., ::2]
    # Other open edges are where boulders and plants stand in the ground.
    outer = ((plan - low < 1e-3) | (high - plan < 1e-3)).any(axis=-1).all(axis=1)
    return Subject(
        "quarry",
        "Synthetic quarry",
        Samples(
            cloud.points, cloud.normals, cloud.colours, cleaned.local_spacing_m, cloud.spacing_m
        ),
        vertices.astype(np.float32),
        true.faces,
        seen[:: max(1, len(seen) // _CHECKS)],
        _along(vertices, edges[outer], 0.25 * cloud.spacing_m),
        closed=False,
        origin="own, procedural (terraport synth)",
        neighbour_colour_p95=_neighbour_colour(cloud.colours, neighbours.indices[:, 0]),
    )


def _turned_out(vertices: Float64, faces: Int32) -> Int32:
    """Faces counter-clockwise seen from outside: some files have them the other way round."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = float(np.einsum("ij,ij->", np.cross(a, b), c))
    return faces if volume >= 0 else np.ascontiguousarray(faces[:, [0, 2, 1]])


def _neighbour_colour(colours: UInt8, nearest: Int32) -> float:
    apart = np.abs(colours.astype(np.int16) - colours[nearest]).max(axis=1)
    return float(np.percentile(apart, 95))


def _along(vertices: Float64 | Float32, edges: Int32, step_m: float) -> Float32:
    """Places along edges, at most `step_m` apart."""
    if len(edges) == 0:
        return np.zeros((0, 3), np.float32)
    start, end = (vertices[edges[:, k]].astype(np.float64) for k in (0, 1))
    count = np.maximum(1, np.ceil(np.linalg.norm(end - start, axis=1) / step_m)).astype(np.int64)
    edge = np.repeat(np.arange(len(edges)), count)
    slot = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    share = ((slot + 0.5) / count[edge])[:, None]
    along: Float32 = (start[edge] * (1 - share) + end[edge] * share).astype(np.float32)
    return along


def _painted(points: Float64, vertices: Float64) -> UInt8:
    """Colours without sharp edges: three waves through the body, a few spacings long."""
    size = float(np.ptp(vertices, axis=0).max())
    phase = points / size * np.array([6.0, 7.0, 9.0]) + np.array([0.0, 1.0, 2.0])
    wave = np.sin(phase + 0.5 * np.roll(phase, 1, axis=1))
    painted: UInt8 = np.rint(150 + 60 * wave).astype(np.uint8)
    return painted
