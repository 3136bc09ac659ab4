"""Meshes for their users: trimesh, the mixed model of a landing, GLB files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from terraport.errors import MissingExtraError, UsageError
from terraport.rim import rim_heights
from terraport.textures import merge_textures, open_texture, vertex_colours
from terraport_payload import (
    AttributeScale,
    SegmentMesh,
    choose_attribute_scale,
    encode_glb,
    snap,
)
from terraport_payload.types import Float32

if TYPE_CHECKING:
    import trimesh

    from terraport.base import BaseMesh

__all__ = ["concatenate", "mixed_model", "to_trimesh", "write_glb"]

_SINK: Final = 1.5
"""Times the measured height: a face tilts as its corners sink by different amounts. Measured at the
rim of landings on two surveys: 1.0 leaves 133 and 21 base pixels per million of detail, 1.5 none
and 3."""
_GREY: Final = 160
"""sRGB of vertices without colour in a mesh of which others have one."""


def to_trimesh(mesh: SegmentMesh) -> trimesh.Trimesh:
    """Return a mesh as a ``trimesh.Trimesh``; nothing is merged, reordered or repaired.

    Attributes go to ``vertex_attributes`` by their survey names, region ids as ``region_id``; a
    texture becomes a ``TextureVisuals`` (whose v points up).

    Raises
    ------
    MissingExtraError
        trimesh is not installed, or for a textured mesh Pillow.
    UsageError
        The texture is of a kind that Pillow cannot read.
    """
    try:
        import trimesh
    except ImportError:
        raise MissingExtraError("to_trimesh()", "trimesh") from None
    extra: dict[str, Any] = dict(mesh.attributes)
    if mesh.region_ids is not None:
        extra["region_id"] = mesh.region_ids
    return trimesh.Trimesh(
        vertices=mesh.positions,
        faces=mesh.faces,
        vertex_normals=mesh.normals,
        vertex_colors=mesh.colours,
        visual=_visual(mesh),
        vertex_attributes=extra,
        process=False,
    )


def _visual(mesh: SegmentMesh) -> Any:
    """Image and coordinates as trimesh holds them; None without."""
    if mesh.uvs is None or mesh.texture is None:
        return None
    from trimesh import visual

    untyped: Any = visual
    material = untyped.material.PBRMaterial(
        baseColorTexture=open_texture(mesh.texture),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    upwards = np.column_stack([mesh.uvs[:, 0], 1.0 - mesh.uvs[:, 1]])
    return untyped.TextureVisuals(uv=upwards, material=material)


def mixed_model(
    base: BaseMesh,
    segments: Mapping[int, SegmentMesh],
    *,
    sink_rim_m: float = 0.0,
    push_back_m: float = 0.0,
    eye: Sequence[float] | None = None,
) -> SegmentMesh:
    """Return what a viewer draws at a landing: the base less its hidden faces, and the detail.

    Parameters
    ----------
    base : BaseMesh
        Of the same scene version as the segments. Its counters are set to these segments.
    segments : mapping of int to SegmentMesh
        Every segment that is shown, by id.
    sink_rim_m : float
        How far at most, in metres against their normals, to move the vertices of base faces that
        segments cover in part, so that the base does not poke through the detail at the rim. Each
        moves half as far again as its faces stand over the segments' vertices below them. For
        files, to be seen from anywhere; the manifest's ``hand_off.deviation_m`` is right.
    push_back_m, eye : float, sequence of 3 floats
        How far to move the whole base away from an eye, along the lines of sight. For pictures from
        that eye: no outline changes by it, and no step opens; ``hand_off.deviation_m`` again.

    Returns
    -------
    SegmentMesh
        Attributes and colours are kept where any part has them; NaN and grey fill the others. Of
        textures see :func:`concatenate`.

    Raises
    ------
    UsageError
        A distance is negative or not finite, or `push_back_m` comes without `eye`.
    MissingExtraError
        Parts have textures, and Pillow is not installed.

    References
    ----------
    ``docs/topics/hand-off.md``, "The rim".
    """
    for name, distance_m in (("sink_rim_m", sink_rim_m), ("push_back_m", push_back_m)):
        if not (np.isfinite(distance_m) and distance_m >= 0):
            raise UsageError(f"{name} is {distance_m}, expected 0 or more")
    if push_back_m and eye is None:
        raise UsageError(f"push_back_m is {push_back_m} without eye, expected both")
    hidden = base.hidden_faces(segments)
    positions = base.mesh.positions
    if sink_rim_m and segments:
        positions = _sunk(base, segments.values(), sink_rim_m)
    if push_back_m and eye is not None:
        sight = positions - np.asarray(eye, dtype=np.float64)
        length = np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), np.finfo(float).tiny)
        positions = (positions + sight / length * push_back_m).astype(np.float32)
    drawn = _without_unused(
        SegmentMesh(
            positions=positions,
            faces=base.mesh.faces[~hidden],
            normals=base.mesh.normals,
            colours=base.mesh.colours,
            region_ids=base.mesh.region_ids,
            attributes=base.mesh.attributes,
            uvs=base.mesh.uvs,
            texture=base.mesh.texture,
        )
    )
    # Without a face left it would bring its whole image for nothing.
    return concatenate([drawn, *segments.values()] if len(drawn.faces) else segments.values())


def concatenate(meshes: Iterable[SegmentMesh]) -> SegmentMesh:
    """Return several meshes as one; vertices are not merged.

    Where some have colours, region ids or an attribute and others do not, the others get grey,
    0 and NaN. Where all have textures, their images become one of at most 4096 x 4096, halved
    until they fit; where only some have, every vertex gets the colour of its texel. No mesh at all
    gives an empty one.

    Raises
    ------
    MissingExtraError
        Several meshes, some with textures, and Pillow is not installed.
    UsageError
        A texture is of a kind that Pillow cannot read, or there are too many.
    """
    parts = list(meshes)
    uvs = texture = None
    if parts and all(part.texture is not None for part in parts):
        uvs, texture = merge_textures(parts)
    elif any(part.texture is not None for part in parts):
        parts = [
            replace(part, colours=vertex_colours(part), uvs=None, texture=None) for part in parts
        ]
    if not parts:
        nothing = np.zeros((0, 3), dtype=np.float32)
        return SegmentMesh(nothing, np.zeros((0, 3), dtype=np.uint32), nothing)
    starts = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    names = list(dict.fromkeys(name for part in parts for name in part.attributes))
    return SegmentMesh(
        positions=np.concatenate([part.positions for part in parts]),
        faces=np.concatenate(
            [part.faces + np.uint32(start) for part, start in zip(parts, starts, strict=True)]
        ),
        normals=np.concatenate([part.normals for part in parts]),
        colours=None
        if all(part.colours is None for part in parts)
        else np.concatenate(
            [
                np.full((len(part.positions), 3), _GREY, dtype=np.uint8)
                if part.colours is None
                else part.colours
                for part in parts
            ]
        ),
        region_ids=None
        if all(part.region_ids is None for part in parts)
        else np.concatenate(
            [
                np.zeros(len(part.positions), dtype=np.uint16)
                if part.region_ids is None
                else part.region_ids
                for part in parts
            ]
        ),
        attributes={
            name: np.concatenate(
                [
                    part.attributes.get(
                        name, np.full(len(part.positions), np.nan, dtype=np.float32)
                    )
                    for part in parts
                ]
            )
            for name in names
        },
        uvs=uvs,
        texture=texture,
    )


def write_glb(
    mesh: SegmentMesh,
    path: str | Path,
    *,
    step_m: float,
    attribute_scales: Mapping[str, AttributeScale] | None = None,
) -> int:
    """Write a mesh as a GLB file, compressed as the scene's own payloads are.

    Parameters
    ----------
    mesh : SegmentMesh
        Positions are snapped to the grid first (a rim that was sunk is not on it).
    path : Path
        Replaced if it is there, in one step: a failure leaves it as it was.
    step_m : float
        Grid step of the scene, metres; its manifest has it.
    attribute_scales : mapping, optional
        By survey name; what is not given is chosen from the values.

    Returns
    -------
    int
        Bytes written.

    Raises
    ------
    terraport_payload.PayloadError
        The mesh cannot be encoded, for example because it is empty.
    OSError
        The file cannot be written.
    """
    scales = dict(attribute_scales or {})
    for name, values in mesh.attributes.items():
        if name not in scales:
            scales[name] = choose_attribute_scale(values)
    on_grid = replace(mesh, positions=snap(mesh.positions, step_m))
    data = encode_glb(on_grid, step_m=step_m, attribute_scales=scales)
    target = Path(path)
    beside = target.with_name(f".{target.name}.tmp")
    try:
        beside.write_bytes(data)
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)
    return len(data)


def _sunk(base: BaseMesh, segments: Iterable[SegmentMesh], most_m: float) -> Float32:
    """Return the base's positions, the rim's lowered below the detail."""
    points = np.concatenate([segment.positions for segment in segments])
    rim = base.mesh.faces[base.counters.rim]
    height = rim_heights(base.mesh.positions, rim, points, most_m=most_m)
    depth = np.minimum(height * np.float32(_SINK), np.float32(most_m))
    lowered: Float32 = base.mesh.positions - depth[:, None] * base.mesh.normals
    return lowered


def _without_unused(mesh: SegmentMesh) -> SegmentMesh:
    """Return the mesh without vertices that no face uses."""
    used = np.zeros(len(mesh.positions), dtype=np.bool_)
    used[mesh.faces] = True
    index = np.cumsum(used, dtype=np.uint32) - np.uint32(1)
    return SegmentMesh(
        positions=mesh.positions[used],
        faces=index[mesh.faces].reshape(-1, 3),
        normals=mesh.normals[used],
        colours=None if mesh.colours is None else mesh.colours[used],
        region_ids=None if mesh.region_ids is None else mesh.region_ids[used],
        attributes={name: values[used] for name, values in mesh.attributes.items()},
        uvs=None if mesh.uvs is None else mesh.uvs[used],
        texture=mesh.texture,
    )
