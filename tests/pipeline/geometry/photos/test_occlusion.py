from __future__ import annotations

import numpy as np
from photo_scene import ground, look_at

from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.mesh.mesh_blocks import mesh_blocks
from terraport_pipeline.geometry.photos.occlusion import visible_faces
from terraport_pipeline.geometry.photos.view_candidates import (
    new_candidates,
    project_blocks,
    rate_faces,
    visible_blocks,
)


def test_the_depth_grid_agrees_with_a_ray_for_every_face() -> None:
    vertices, faces = ground(160)  # many faces, so that the grid is used
    blocks = mesh_blocks(vertices, faces)
    rays = RayScene(blocks.vertices, blocks.faces, threads=1)
    view = look_at("a", (4.0, 30.0, 10.0), (22.0, 0.0, 20.0))
    packed, seen = view.packed(), visible_blocks(blocks, view)
    uv = np.empty((len(vertices), 2), np.float32)
    project_blocks(blocks, packed, seen, uv)
    rated = rate_faces(
        blocks, packed, seen, uv, np.ones((1, 1), np.float32), new_candidates(len(faces)),
        min_cosine=0.1,
    )  # fmt: skip
    assert len(rated.face) > 5000
    visible, cast = visible_faces(blocks, view, rated, rays)
    assert cast < 0.8 * len(rated.face)
    corners = blocks.vertices[blocks.faces[rated.face]].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    width = np.sqrt(np.linalg.norm(normal, axis=1))
    lift = 0.25 * width[:, None] * normal / (width**2)[:, None]
    start = corners.mean(axis=1) + lift
    distance, _ = rays.closest_hit(start, view.position - start)
    truth = ~(distance < 1.0)
    assert (~truth).sum() > 200
    # nothing hidden passes, but for faces at the rim of what hides them
    assert (visible & ~truth).mean() < 0.002
    assert (~visible & truth).mean() < 0.002
