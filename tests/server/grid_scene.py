"""Scenes for the service's tests: a grid of square segments in the plane, made from a formula.

Segment ``row * SIDE + column`` covers x from ``10 * column`` and z from ``10 * row``, 10 m each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from terraport_payload import (
    AttributeScale,
    Cover,
    SegmentMesh,
    decode_segment,
    encode_glb,
    encode_segment,
    gltf_attribute_name,
)
from terraport_pipeline.engines.coarser import coarser
from terraport_store import (
    AttributeInfo,
    BuildInfo,
    HandOff,
    Manifest,
    SceneInfo,
    SceneWriter,
    SurveyUnits,
)

SIDE = 6
TILE_M = 10.0
STEP_M = 2.0**-9
SCALES = {"grade": AttributeScale(offset=0.0, step=2.0**-10)}


@dataclass(frozen=True)
class GridScene:
    """A published scene of a grid, and what its segments must decode to."""

    path: Path
    manifest: Manifest
    payloads: list[bytes]
    meshes: list[SegmentMesh]

    def glb(self, segment: int) -> bytes:
        """The GLB that a server makes of a segment."""
        mesh = decode_segment(self.payloads[segment], scales=SCALES)
        return encode_glb(mesh, step_m=STEP_M, attribute_scales=SCALES)


def tile_mesh(row: int, column: int, cells: int, *, seed: int = 0, tiles: int = 1) -> SegmentMesh:
    """A gently wavy square of ``tiles`` tiles a side; y stays within 0 to 2."""
    lattice = np.arange(cells + 1)
    i, j = (axis.reshape(-1) for axis in np.meshgrid(lattice, lattice, indexing="ij"))
    spacing_m = TILE_M * tiles / cells
    x, z = TILE_M * column + i * spacing_m, TILE_M * row + j * spacing_m
    y = 1.0 + 0.5 * np.sin(0.4 * x + seed) * np.cos(0.3 * z)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1)
    step = cells + 1
    # Counter-clockwise from above: x grows with i, z with j.
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + step + 1], axis=1),
            np.stack([corner, corner + step + 1, corner + step], axis=1),
        ]
    )
    grade = (0.5 + 0.01 * x).astype(np.float32)
    return SegmentMesh(
        positions=np.stack([x, y, z], axis=1).astype(np.float32),
        faces=faces.astype(np.uint32),
        normals=np.tile(np.array([0, 1, 0], dtype=np.float32), (len(x), 1)),
        colours=np.stack([i % 256, j % 256, (i + j) % 256], axis=1).astype(np.uint8),
        region_ids=np.full(len(x), row % 3, dtype=np.uint16),
        attributes={"grade": grade},
    )


def shuffled(mesh: SegmentMesh) -> SegmentMesh:
    """The mesh with faces in random order and random colours: a payload as long as a survey's."""
    random = np.random.default_rng(1)
    return replace(
        mesh,
        faces=mesh.faces[random.permutation(len(mesh.faces))],
        colours=random.integers(0, 256, mesh.positions.shape, dtype=np.uint8),
    )


def write_grid_scene(
    path: Path,
    *,
    seed: int = 0,
    cells: int = 12,
    name: str = "grid",
    stable_ids: tuple[int, ...] | None = None,
    survey_units: SurveyUnits | None = None,
    levels: int = 1,
    slope: bool = False,
) -> GridScene:
    """Publish a grid of SIDE x SIDE segments; another seed is another version.

    Meshes are as :func:`shuffled` makes them. With three ``stable_ids`` the regions have them, and
    the next one is 10. With two ``levels`` the
    payloads of the coarser one stand behind those of the segments. With ``slope`` vertices have a
    second attribute.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    meshes = [
        tile_mesh(row, column, cells, seed=seed) for row in range(SIDE) for column in range(SIDE)
    ]
    scales = SCALES
    if slope:
        scales = SCALES | {"slope": SCALES["grade"]}
        meshes = [
            replace(mesh, attributes=mesh.attributes | {"slope": mesh.attributes["grade"]})
            for mesh in meshes
        ]
    meshes += [coarser(mesh) for mesh in meshes * (levels - 1)]
    payloads = [encode_segment(shuffled(mesh), step_m=STEP_M, scales=scales) for mesh in meshes]
    decoded = [decode_segment(payload, scales=scales) for payload in payloads]
    base = tile_mesh(0, 0, SIDE, seed=seed, tiles=SIDE)
    with SceneWriter(path) as writer:
        for number, (payload, mesh) in enumerate(zip(payloads, decoded, strict=True)):
            segment = number % (SIDE * SIDE)
            box = decoded[segment].positions
            writer.add_segment(
                payload,
                region=segment // SIDE % 3,
                bounds=[*box.min(axis=0), *box.max(axis=0)],
                vertices=len(mesh.positions),
                faces=len(mesh.faces),
            )
        writer.set_base(
            encode_segment(base, step_m=STEP_M, scales=SCALES),
            _cover(),
        )
        writer.set_regions(_regions(stable_ids))
        attributes = tuple(_attribute(each) for each in scales)
        info = replace(
            _info(name, seed), survey_units=survey_units, levels=levels, attributes=attributes
        )
        manifest = writer.publish(info)
    return GridScene(path, manifest, payloads, decoded)


def _regions(stable_ids: tuple[int, ...] | None) -> dict[str, Any]:
    regions: list[dict[str, Any]] = [{"id": 0, "label": "road"}, {"id": 1}, {"id": 2}]
    if stable_ids is None:
        return {"regions": regions}
    for region, number in zip(regions, stable_ids, strict=True):
        region["stable_id"] = number
    return {"regions": regions, "next_stable_id": 10}


def _cover() -> Cover:
    """Base quad (column i, row j) lies under segment row j, column i; each quad is two faces."""
    quad = np.arange(SIDE * SIDE)
    segment = (quad % SIDE) * SIDE + quad // SIDE
    rows = np.concatenate([segment, segment]).astype(np.uint32)
    return Cover(np.arange(len(rows) + 1, dtype=np.uint32), rows)


def _info(name: str, seed: int) -> SceneInfo:
    return SceneInfo(
        name=name,
        origin=(500_000.0, 8_000_000.0, 100.0),
        step_m=STEP_M,
        points=1000,
        regions=3,
        hand_off=HandOff(deviation_m=0.01, tolerance_m=0.05),
        build=BuildInfo(terraport="0.1.0", options={"seed": seed}),
        attributes=(_attribute("grade"),),
    )


def _attribute(name: str) -> AttributeInfo:
    return AttributeInfo(
        name=name,
        gltf_name=gltf_attribute_name(name),
        offset=0.0,
        step=SCALES["grade"].step,
        min=0.0,
        max=2.0,
    )
