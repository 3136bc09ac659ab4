"""Check one mesh of a scene against what manifest and index say of it."""

from __future__ import annotations

import numpy as np

from terraport_payload import PayloadError, SegmentMesh
from terraport_payload.grid import MAX_CODE, grid_codes
from terraport_payload.types import Float32, Float64
from terraport_store.errors import CorruptPayloadError, RangeError
from terraport_store.findings import Findings
from terraport_store.layout import ENCODING, MAX_SEGMENT_SIDE
from terraport_store.manifest import AttributeInfo, Manifest
from terraport_store.opening import largest_texture
from terraport_store.reader import Scene

__all__ = ["border_of", "box_of", "check_mesh_fits", "check_segment"]


def check_segment(out: Findings, scene: Scene, segment: int) -> None:
    """Check one segment: hash, decoding, counts, box, regions, grid, attributes.

    Parameters
    ----------
    out : Findings
        Gets what is wrong.
    scene : Scene
        Open.
    segment : int
        Segment id, or the row of a coarser level.
    """
    manifest, index = scene.manifest, scene.rows
    file = manifest.files[manifest.encodings[ENCODING].pack].path
    mesh = _decoded(out, scene, segment)
    if mesh is None:
        return
    counted = (len(mesh.positions), len(mesh.faces))
    expected = (int(index.vertex_count[segment]), int(index.face_count[segment]))
    if counted != expected:
        out.error(
            "payload-count",
            file,
            f"{counted[0]} vertices and {counted[1]} faces, "
            f"expected {expected[0]} and {expected[1]} by the index",
            segment=segment,
        )
    box, is_coarser = box_of(mesh), segment >= len(scene.index)
    stated = index.bounds[segment]
    inside = (box[:3] >= stated[:3]).all() and (box[3:] <= stated[3:]).all()
    if not (inside if is_coarser else np.array_equal(box, stated)):
        out.error(
            "payload-bounds",
            file,
            f"box {box.tolist()}, expected {stated.tolist()} by the index",
            segment=segment,
        )
    image = mesh.texture
    texture = (0, 0, 0) if image is None else (image.width, image.height, image.bits)
    said = tuple(index.texture[segment].tolist())
    # An index that does not say it is read as if every texture were as large as the largest.
    if said not in (texture, largest_texture(manifest)):
        out.error(
            "payload-texture",
            file,
            f"texture of {texture[0]} x {texture[1]} pixels and {texture[2]} bits a texel, "
            f"expected {said} by the index",
            segment=segment,
        )
    if is_coarser:
        _check_level(out, scene, mesh, file, segment)
    if mesh.region_ids is not None:
        ids = np.unique(mesh.region_ids)
        if len(ids) != int(index.region_count[segment]) or int(index.region[segment]) not in ids:
            out.error(
                "payload-region",
                file,
                f"{len(ids)} regions, expected {int(index.region_count[segment])} "
                f"with {int(index.region[segment])} among them by the index",
                segment=segment,
            )
    check_mesh_fits(out, manifest, mesh, file, segment)


def _check_level(out: Findings, scene: Scene, mesh: SegmentMesh, file: str, row: int) -> None:
    """Check that a coarser level has the border of its segment, bit for bit."""
    detail = _decoded(out, scene, row % len(scene.index))
    if detail is not None and not np.array_equal(border_of(detail), border_of(mesh)):
        out.error(
            "level-border",
            file,
            "another border than at full detail, expected the same edges, bit for bit",
            segment=row,
        )


def border_of(mesh: SegmentMesh) -> Float64:
    """Find the edges that an odd number of faces use, by their ends' positions.

    Two surfaces with equal borders close the same gap: next to any third one neither opens.

    Returns
    -------
    ndarray of shape (E, 6), float64
        x, y, z of both ends, metres; ordered, so that equal sets are equal arrays.
    """
    positions, place = np.unique(mesh.positions, axis=0, return_inverse=True)
    faces = place.reshape(-1)[mesh.faces.astype(np.int64)]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges, counts = np.unique(np.sort(ends, axis=1), axis=0, return_counts=True)
    odd = positions[edges[counts % 2 == 1]].astype(np.float64).reshape(-1, 6)
    ordered: Float64 = np.unique(odd, axis=0)
    return ordered


def check_mesh_fits(
    out: Findings, manifest: Manifest, mesh: SegmentMesh, file: str, segment: int | None
) -> None:
    """Check what base and segments have in common: grid, colour, regions, attributes.

    Parameters
    ----------
    out : Findings
        Gets what is wrong.
    manifest : Manifest
        Of the scene.
    mesh : SegmentMesh
        Decoded.
    file : str
        Where it comes from, relative to the scene directory.
    segment : int or None
        Segment id; None for the base.
    """
    try:
        codes = grid_codes(mesh.positions, manifest.step_m)
    except PayloadError as error:
        out.error("grid", file, error.what, segment=segment)
        return
    span = int((codes.max(axis=0) - codes.min(axis=0)).max())
    if segment is not None and span > MAX_CODE:
        out.error("wide", file, f"{span} steps wide, expected at most {MAX_CODE}", segment=segment)
    off = np.flatnonzero((codes * manifest.step_m != mesh.positions).any(axis=1))
    if len(off):
        out.error(
            "grid",
            file,
            f"{len(off)} vertices off the grid, expected multiples of {manifest.step_m} m",
            segment=segment,
        )
    dressed = segment is None and mesh.texture is not None
    if mesh.colours is None and manifest.has_colour and not dressed:
        out.error("colour", file, "no colours, expected some since has_colour", segment=segment)
    _check_texture(out, manifest, mesh, file, segment)
    if mesh.region_ids is not None and int(mesh.region_ids.max()) >= manifest.counts.regions:
        out.error(
            "region",
            file,
            f"region {int(mesh.region_ids.max())}, expected below {manifest.counts.regions}",
            segment=segment,
        )
    for info in manifest.attributes:
        _check_range(out, info, mesh, file, segment)


def box_of(mesh: SegmentMesh) -> Float32:
    """Axis-aligned box, (6,): x, y, z minimum, x, y, z maximum."""
    return np.concatenate([mesh.positions.min(axis=0), mesh.positions.max(axis=0)])


def _check_texture(
    out: Findings, manifest: Manifest, mesh: SegmentMesh, file: str, segment: int | None
) -> None:
    if mesh.texture is None:
        return
    side = max(mesh.texture.width, mesh.texture.height)
    if manifest.textures is None:
        out.error("texture", file, "a texture, expected none by scene.json", segment=segment)
        return
    stated = manifest.textures
    most = stated.base_side if segment is None else min(stated.max_side, MAX_SEGMENT_SIDE)
    if side > most:
        out.error(
            "texture", file, f"image of {side} pixels, expected at most {most}", segment=segment
        )
    if mesh.texture.media_type not in stated.media_types:
        out.error(
            "texture",
            file,
            f"image is {mesh.texture.media_type}, expected one of {list(stated.media_types)} by "
            "scene.json",
            segment=segment,
        )


def _decoded(out: Findings, scene: Scene, segment: int) -> SegmentMesh | None:
    file = scene.manifest.files[scene.manifest.encodings[ENCODING].pack].path
    try:
        return scene.mesh(segment)
    except CorruptPayloadError as error:
        out.error("payload-hash", file, error.what, segment=segment, offset=error.offset)
    except PayloadError as error:
        out.error("payload-decode", file, error.what, segment=segment, offset=error.offset)
    except RangeError as error:
        out.error("payload-range", file, str(error), segment=segment)
    return None


def _check_range(
    out: Findings,
    info: AttributeInfo,
    mesh: SegmentMesh,
    file: str,
    segment: int | None,
) -> None:
    values = mesh.attributes.get(info.name)
    if values is None:
        return
    present = values[~np.isnan(values)].astype(np.float64)
    if not len(present):
        return
    low, high = float(present.min()), float(present.max())
    # Half a step for quantisation, and float32's own rounding.
    slack = info.step * 0.5 + 1e-6 * max(abs(low), abs(high))
    if info.min is None or info.max is None or low < info.min - slack or high > info.max + slack:
        out.error(
            "attribute-range",
            file,
            f"{info.name} from {low} to {high}, "
            f"expected within {info.min} to {info.max} by scene.json",
            segment=segment,
        )
