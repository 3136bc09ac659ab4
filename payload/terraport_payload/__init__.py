"""Payload codecs: one segment, or the base mesh, between arrays and bytes.

Both are stored and sent in segment format 2 (:func:`encode_segment`, :func:`decode_segment`;
``spec/segment-format.md``). :func:`encode_glb` writes a mesh for other programs.

PURE: no I/O, no clock; depends on NumPy, meshopt and xxhash alone. Every function is thread-safe.
"""

from __future__ import annotations

from terraport_payload.boxes import box_distances_m
from terraport_payload.cover import Cover
from terraport_payload.errors import PayloadError
from terraport_payload.glb_encode import encode_glb, gltf_attribute_name
from terraport_payload.grid import AttributeScale, choose_attribute_scale, choose_step_m, snap
from terraport_payload.mesh import SegmentMesh
from terraport_payload.segment_format import decode_segment, encode_segment, segment_bounds
from terraport_payload.texture import Texture
from terraport_payload.uv import snap_uvs

__all__ = [
    "AttributeScale",
    "Cover",
    "PayloadError",
    "SegmentMesh",
    "Texture",
    "box_distances_m",
    "choose_attribute_scale",
    "choose_step_m",
    "decode_segment",
    "encode_glb",
    "encode_segment",
    "gltf_attribute_name",
    "segment_bounds",
    "snap",
    "snap_uvs",
]
