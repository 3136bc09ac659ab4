"""A scene small enough to reason about: 2 x 2 segments of one hilly patch, made from a formula.

Segments share border positions (not indices): vertex (i, j) of the lattice is the same float32
triple wherever it is used.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xxhash

from terraport_payload import (
    AttributeScale,
    Cover,
    SegmentMesh,
    Texture,
    encode_segment,
    gltf_attribute_name,
)
from terraport_store import (
    AttributeInfo,
    BuildInfo,
    HandOff,
    Manifest,
    SceneInfo,
    SceneWriter,
    TextureInfo,
)
from terraport_store.layout import ENCODING, PACK_HEADER_BYTES, pack_header
from terraport_store.manifest import manifest_digest

STEP_M = 2.0**-12
CELLS = 6
"""Quads along one side of a segment."""
SPACING_M = 0.25
SCALES = {
    "grade": AttributeScale(offset=0.0, step=2.5 / 65534),
    "height_change_m": AttributeScale(offset=-256.0, step=2.0**-7),
}
CHANGE = AttributeInfo(
    name="height_change_m",
    gltf_name="_HEIGHT_CHANGE_M",
    offset=-256.0,
    step=2.0**-7,
    min=-1.5,
    max=0.5,
)


def lattice_mesh(
    i0: int, j0: int, cells: int = CELLS, *, stride: int = 1, seed: int = 0
) -> SegmentMesh:
    """A square of the hilly patch: cells x cells quads from lattice vertex (i0, j0)."""
    i, j = np.meshgrid(
        i0 + stride * np.arange(cells + 1), j0 + stride * np.arange(cells + 1), indexing="ij"
    )
    i, j = i.reshape(-1), j.reshape(-1)
    x, z = i * SPACING_M, -j * SPACING_M
    phase = seed * 0.7
    y = 1.0 + 0.4 * np.sin(1.3 * x + phase) * np.cos(0.9 * z)
    slope_x = 0.52 * np.cos(1.3 * x + phase) * np.cos(0.9 * z)
    slope_z = -0.36 * np.sin(1.3 * x + phase) * np.sin(0.9 * z)
    normals = np.stack([-slope_x, np.ones_like(x), -slope_z], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    side = cells + 1
    corner = (np.arange(cells)[:, None] * side + np.arange(cells)[None, :]).reshape(-1)
    # Counter-clockwise from above: x grows with i, z falls with j.
    faces = np.concatenate(
        [
            np.stack([corner, corner + side, corner + side + 1], axis=1),
            np.stack([corner, corner + side + 1, corner + 1], axis=1),
        ]
    )
    grade = (1.0 + np.sin(x) * np.cos(z)).astype(np.float32)
    grade[::17] = np.nan
    colours = np.stack([(i * 7 + 90) % 256, (j * 11 + 80) % 256, (i + j) * 3 % 256], axis=1)
    return SegmentMesh(
        positions=np.stack([x, y, z], axis=1).astype(np.float32),
        faces=faces.astype(np.uint32),
        normals=normals.astype(np.float32),
        colours=colours.astype(np.uint8),
        region_ids=np.full(len(x), (i0 + j0) // CELLS, dtype=np.uint16),
        attributes={"grade": grade},
    )


@dataclass(frozen=True)
class TinyScene:
    """A published scene of the patch, and the meshes that it was made of."""

    path: Path
    manifest: Manifest
    segments: list[SegmentMesh]
    payloads: list[bytes]


def write_tiny_scene(
    path: Path,
    *,
    seed: int = 0,
    copies: int = 1,
    stable_ids: tuple[int, ...] | None = None,
    image: bytes | None = None,
    base_image: bytes | None = None,
    changed: bool = False,
) -> TinyScene:
    """Publish the patch; another seed is another version; copies repeats every segment.

    With three ``stable_ids`` the regions have them, and the next one is 10. With an ``image`` the
    base and every other segment have it for a texture; with a ``base_image`` the base alone has.
    Where it ``changed``, the last segment alone says how far, and the others lack that attribute.
    """
    tiles = [(i, j) for i in (0, CELLS) for j in (0, CELLS)] * copies
    segments = [lattice_mesh(i, j, seed=seed) for i, j in tiles]
    base = lattice_mesh(0, 0, 4, stride=3, seed=seed)
    if image is not None:
        base = textured(base, image)
        segments[::2] = [textured(mesh, image) for mesh in segments[::2]]
    elif base_image is not None:
        base = textured(base, base_image)
    if changed:
        segments[-1] = sunken(segments[-1])
    scales = SCALES if changed else {"grade": SCALES["grade"]}
    payloads = [encode_segment(mesh, step_m=STEP_M, scales=scales) for mesh in segments]
    with SceneWriter(path) as writer:
        for (i, j), payload in zip(tiles, payloads, strict=True):
            writer.add_segment(payload, region=(i + j) // CELLS)
        writer.set_base(
            encode_segment(base, step_m=STEP_M, scales=SCALES),
            base_cover(),
        )
        writer.set_regions(tiny_regions(stable_ids))
        info = scene_info(seed, image=image, textured=len(segments[::2]), base_image=base_image)
        if changed:
            info = replace(info, attributes=(*info.attributes, CHANGE))
        manifest = writer.publish(info)
    return TinyScene(path, manifest, segments, payloads)


def add_encoding(scene: TinyScene, name: str = "later") -> Path:
    """Give a scene a further encoding, as a later minor version of the format may; its path.

    The payloads are the same, in a pack that says the other name.
    """
    document = json.loads((scene.path / "scene.json").read_bytes())
    files, ours = document["files"], document["encodings"][ENCODING]
    pack, index = ((scene.path / files[ours[key]]["path"]) for key in ("pack", "index"))
    for key, data in (
        (f"segments.{name}.pack", pack_header(name) + pack.read_bytes()[PACK_HEADER_BYTES:]),
        (f"segments.{name}.idx", index.read_bytes()),
    ):
        (pack.parent / key).write_bytes(data)
        path = f"{pack.parent.name}/{key}"
        files[key] = {"path": path, "bytes": len(data), "xxh3": xxhash.xxh3_64_hexdigest(data)}
    document["encodings"][name] = ours | {
        "pack": f"segments.{name}.pack",
        "index": f"segments.{name}.idx",
    }
    document["version"] = manifest_digest(document)
    (scene.path / "scene.json").write_text(json.dumps(document))
    return scene.path


def tiny_regions(stable_ids: tuple[int, ...] | None = None) -> dict[str, Any]:
    """Contents of regions.json."""
    regions: list[dict[str, Any]] = [{"id": 0}, {"id": 1, "label": "bench"}, {"id": 2}]
    if stable_ids is None:
        return {"regions": regions}
    for region, number in zip(regions, stable_ids, strict=True):
        region["stable_id"] = number
    return {"regions": regions, "next_stable_id": 10}


def base_cover() -> Cover:
    """Base quad (a, b) of 4 x 4 lies under the segment of its quarter; each quad is two faces."""
    quad = np.arange(16)
    segment = (quad // 4 // 2) * 2 + quad % 4 // 2
    rows = np.concatenate([segment, segment]).astype(np.uint32)
    return Cover(np.arange(33, dtype=np.uint32), rows)


def textured(mesh: SegmentMesh, image: bytes) -> SegmentMesh:
    """The mesh with an image in place of its colours, stretched over its plan."""
    plan = mesh.positions[:, [0, 2]]
    low, high = plan.min(axis=0), plan.max(axis=0)
    uvs = ((plan - low) / (high - low)).astype(np.float32)
    return replace(mesh, colours=None, uvs=uvs, texture=Texture.of(image))


def sunken(mesh: SegmentMesh) -> SegmentMesh:
    """The mesh with how far its ground sank and rose; every third vertex does not say."""
    steps = np.linspace(-1.5, 0.5, len(mesh.positions), dtype=np.float32)
    steps[1::3] = np.nan
    return replace(mesh, attributes={**mesh.attributes, "height_change_m": steps})


def scene_info(
    seed: int = 0,
    *,
    image: bytes | None = None,
    textured: int = 0,
    base_image: bytes | None = None,
) -> SceneInfo:
    """What the manifest says of the patch."""
    textures = None
    if base_image is not None:
        texture = Texture.of(base_image)
        textures = TextureInfo(
            source="vertex",
            media_types=(texture.media_type,),
            segments=0,
            base_side=max(texture.width, texture.height),
            max_side=0,
            image_bytes=0,
            texels=0,
            texel_m=0.2,
        )
    if image is not None:
        texture = Texture.of(image)
        side = max(texture.width, texture.height)
        textures = TextureInfo(
            source="photos",
            media_types=(texture.media_type,),
            segments=textured,
            base_side=side,
            max_side=side,
            image_bytes=textured * len(image),
            texels=textured * texture.width * texture.height,
            texel_m=0.1,
            gsd_m=0.05,
        )
    return SceneInfo(
        name=f"tiny {seed}",
        origin=(500000.0, 8000000.0, 100.0),
        step_m=STEP_M,
        points=1000,
        regions=3,
        has_colour=image is None,
        textures=textures,
        hand_off=HandOff(deviation_m=0.01, tolerance_m=0.05),
        build=BuildInfo(terraport="0.1.0", options={"seed": seed}),
        attributes=(
            AttributeInfo(
                name="grade",
                gltf_name=gltf_attribute_name("grade"),
                offset=0.0,
                step=SCALES["grade"].step,
                min=0.0,
                max=2.0,
            ),
        ),
    )
