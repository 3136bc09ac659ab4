"""The ground of a published scene, face by face: what is cut anew, and what features are read off.

Memory: about 150 bytes per face of the detail, so a scene is refused beyond :data:`MAX_FACES`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float64, Int32
from terraport_pipeline.errors import ResourceError
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.face_blocks import welded_places
from terraport_pipeline.geometry.mesh.face_measures import face_areas, face_centres
from terraport_pipeline.model import Mesh
from terraport_pipeline.progress import Progress
from terraport_pipeline.published.scene_model import load_scene_model
from terraport_store import LabelError, RegionNames, Scene, read_labels

__all__ = ["MAX_FACES", "Ground", "read_ground"]

MAX_FACES: Final = 64_000_000
"""Faces of a scene that regions are brought to or taught: some 10 GB."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Every face of the detail in one mesh, in the order of the segments."""

    version: str
    document: Mapping[str, Any]
    """Contents of regions.json."""
    names: RegionNames
    """Stable ids, and what people call the regions."""
    mesh: Mesh
    """Vertices at one place are one, whichever segments they are of."""
    segment_of_face: Int32
    """(F,)"""
    region_of_face: Int32
    """(F,) by number in this version."""

    @cached_property
    def area(self) -> Float64:
        """(F,) square metres."""
        return face_areas(self.mesh.vertices, self.mesh.faces)

    @cached_property
    def centres(self) -> Float64:
        """(F, 3) metres, scene frame."""
        return face_centres(self.mesh.vertices, self.mesh.faces)

    @cached_property
    def pairs(self) -> tuple[Int32, Int32]:
        """Neighbouring faces (P, 2), and the vertices of their edge (P, 2)."""
        return face_pairs(self.mesh.faces, len(self.mesh.vertices))


def read_ground(scene: Scene, progress: Progress) -> Ground:
    """Read the detail of a scene with its regions.

    Parameters
    ----------
    scene : Scene
        Open.
    progress : Progress
        A step of segments.

    Raises
    ------
    LabelError
        The scene gives no stable ids.
    ResourceError
        It has more than :data:`MAX_FACES`.
    DamagedSceneError
        Something in it cannot be read.
    """
    document = scene.regions
    names = RegionNames.of(document, file=scene.manifest.files["regions.json"].path)
    if names.stable_ids is None:
        raise LabelError("regions.json gives no stable ids; build the scene again, then label it")
    faces = scene.manifest.counts.detail_faces
    if faces > MAX_FACES:
        raise ResourceError(
            f"{faces:,} faces, expected at most {MAX_FACES:,}: what regions are brought to or "
            "taught is held in memory; build it with fewer points (--max-points), or in two scenes "
            "(--extent)"
        )
    model = load_scene_model(scene, progress=progress)
    detail = model.detail
    stays, place = welded_places(detail.vertices)
    mesh = Mesh(
        detail.vertices[stays],
        place[detail.faces].astype(np.int32),
        detail.normals[stays],
        detail.colours[stays],
        {name: values[stays] for name, values in detail.attributes.items()},
    )
    region = model.region_of_face
    if (region < 0).any():
        main = scene.index.region[model.segment_of_face].astype(np.int32)
        region = np.where(region < 0, main, region)
    return Ground(
        scene.manifest.version,
        document,
        names.with_labels(read_labels(scene.files)),
        mesh,
        model.segment_of_face,
        region,
    )
