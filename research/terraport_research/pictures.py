"""Pictures of reconstructions: all of one subject from one place, the inside in orange.

A hole shows the sky, or the orange inside of the far wall.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float32, Int32, UInt8
from terraport_pipeline.engines.cameras import Camera, oblique
from terraport_pipeline.engines.pictures import encode_jpeg, render_mesh, render_points
from terraport_pipeline.engines.rays import RayScene
from terraport_research.subjects import Subject

__all__ = ["SIZE", "picture_of_mesh", "picture_of_samples"]

SIZE: Final = (480, 360)
SUPERSAMPLE: Final = 2
INSIDE: Final = np.array([255, 140, 0], np.float32)
_FRAMED: Final = 4000
"""Samples that the camera frames."""


def picture_of_samples(subject: Subject) -> bytes:
    """Draw a subject's samples as splats and encode the picture as JPEG."""
    samples = subject.samples
    image = render_points(
        samples.points,
        samples.colours,
        _camera(subject),
        SIZE,
        spacing_m=samples.spacing_m,
        supersample=SUPERSAMPLE,
    )
    return encode_jpeg(image)


def picture_of_mesh(
    subject: Subject, vertices: Float32, faces: Int32, colours: UInt8 | None
) -> bytes:
    """Draw a mesh where the cloud is; JPEG.

    Parameters
    ----------
    subject : Subject
        Chooses the view.
    vertices : ndarray of shape (V, 3), float32
    faces : ndarray of shape (F, 3), int32
    colours : ndarray of shape (V, 3), uint8, optional
        Grey without.
    """
    camera = _camera(subject)
    scene = RayScene(vertices, faces)
    image = render_mesh(
        vertices,
        faces,
        camera,
        SIZE,
        colours=colours,
        relief=0.75 if subject.closed else 0.35,
        shadows=False,
        supersample=SUPERSAMPLE,
        scene=scene,
    )
    return encode_jpeg(_with_inside(image, vertices, faces, camera, scene))


def _camera(subject: Subject) -> Camera:
    points = subject.samples.points
    step = max(1, len(points) // _FRAMED)
    # Bodies from low and in front, as the thesis shows them; ground from above.
    elevation = 25.0 if subject.closed else 35.0
    azimuth = -20.0 if subject.closed else 30.0
    return oblique(
        points[::step], aspect=SIZE[0] / SIZE[1], azimuth_deg=azimuth, elevation_deg=elevation
    )


def _with_inside(
    image: UInt8, vertices: Float32, faces: Int32, camera: Camera, scene: RayScene
) -> UInt8:
    """Tint the pixels that show a face from behind."""
    starts, headings = camera.rays(SIZE[0], SIZE[1])
    hits = scene.intersect(starts, headings)
    met = np.flatnonzero(hits.face >= 0)
    a, b, c = (vertices[faces[hits.face[met], k]] for k in range(3))
    behind = np.einsum("ij,ij->i", np.cross(b - a, c - a), headings[met]) > 0
    flat = image.reshape(-1, 3).copy()
    rows = met[behind]
    flat[rows] = np.rint(0.35 * flat[rows] + 0.65 * INSIDE).astype(np.uint8)
    return flat.reshape(image.shape)
